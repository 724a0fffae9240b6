"""Runs the estimator over a recorded run again, as fast as it can, and compares to the last bit."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from runtime.errors import UsageError
from runtime.fault_isolation import defects_line, step_or_predict
from runtime.importers.mount import mount_of_import
from runtime.live.timekeeping import Durations
from runtime.map_files.start import AS_RECORDED, BeginIn, RunStart, for_estimator
from runtime.messages.estimate import encode_estimate
from runtime.messages.recorded_tick import RecordedTick
from runtime.messages.records import outcome_records
from runtime.messages.tick import Record
from runtime.record.check import alterations_of
from runtime.record.folder import RunFolder
from runtime.record.header import installed_versions, other_versions
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.replay.difference import Deviation, first_difference
from runtime.service.processor import other_kind
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.settings.retired import ignored_settings
from runtime.tick import CompletedTick, Timing
from slam.estimate import Estimate
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings

Progress = Callable[[float], None]
EstimatorFactory = Callable[[SlamSettings, int], Estimator]
TICKS_A_REPORT = 25


@dataclass(slots=True)
class ReplayResult:
    """How a replay went.

    defects: ticks whose step raised and ended as a prediction; defect: why the first of them did.
    compared: ticks that had an estimate to compare with. difference: one sentence on the first tick that differs.
    altered: what of the record is not as it was closed, sentences; looked for by a replay that verifies.
    other_processor: how the recording one differs in kind from this one, "" if it does not; then `deviation` is known.
    identical: None when nothing was compared.
    """

    ticks: int = 0
    scans: int = 0
    compared: int = 0
    difference: str = ""
    truncated: str = ""
    altered: list[str] = field(default_factory=list)
    other_processor: str = ""
    deviation: Deviation = field(default_factory=Deviation)
    first_stamp_ns: int = 0
    last_stamp_ns: int = 0
    elapsed_s: float = 0.0
    landmarks: int = 0
    steps: Durations = field(default_factory=Durations)
    defects: int = 0
    defect: str = ""

    @property
    def identical(self) -> bool | None:
        """Whether everything compared was equal to the last bit; None when there was nothing to compare."""
        return not self.difference if self.compared or self.difference else None

    @property
    def within_tolerance(self) -> bool | None:
        """Whether a replay on a processor of another kind is as near as it can be; None where the kind is the same."""
        if not self.other_processor or not self.difference:
            return None
        return self.deviation.is_allowed

    @property
    def recording_s(self) -> float:
        """Seconds that the recording spans."""
        return (self.last_stamp_ns - self.first_stamp_ns) * 1e-9


def replay(
    reader: RunReader,
    configuration: Configuration,
    out: RunFolder | None = None,
    verify: bool = False,
    progress: Progress | None = None,
    estimator_factory: EstimatorFactory | None = None,
    start: RunStart | None = None,
) -> ReplayResult:
    """Step the estimator over every tick; write a run of its own into `out`; with `verify` compare with the record.

    start: the saved map that it begins in. Ticks stream through one by one: memory does not grow with the length of
    the run. Raises StorageError.
    """
    make = estimator_factory or partial(Estimator, start=for_estimator(start))
    estimator = make(configuration.slam, configuration.seed)
    writer = _writer(reader, configuration, out, start)
    result = ReplayResult(other_processor=other_kind(reader.header.versions, installed_versions()) if verify else "")
    began_ns = time.perf_counter_ns()
    try:
        for recorded in reader.ticks():
            step_began_ns = time.perf_counter_ns()
            estimate, events = step_or_predict(estimator, recorded.tick)
            step_ns = time.perf_counter_ns() - step_began_ns
            result.steps.add(step_ns)
            state_hash = estimator.state_hash()
            defect = "; ".join(event.reason for event in events)
            result.defects, result.defect = result.defects + bool(events), result.defect or defect
            if verify and not result.difference:
                _compare(result, recorded, estimate, state_hash)
            if verify and result.other_processor:
                result.deviation.note(recorded, estimate)
            if writer is not None:
                writer.add(_records(recorded, estimate, step_ns, state_hash, defect))
            _note(result, recorded, estimate)
            if progress is not None and result.ticks % TICKS_A_REPORT == 0:
                progress(reader.read_fraction)
    finally:
        if writer is not None:
            writer.close()
    result.truncated = reader.truncated
    if verify:
        result.altered = alterations_of(reader)
    result.elapsed_s = (time.perf_counter_ns() - began_ns) * 1e-9
    if progress is not None:
        progress(1.0)
    return result


def replay_run(
    run: Path,
    config: Path | None,
    out: Path | None,
    verify: bool,
    overrides: Mapping[str, str],
    progress: Progress | None = None,
    begin: BeginIn = AS_RECORDED,
) -> dict[str, Any]:
    """The command: choose the configuration and where the estimates go, replay, and return its summary.

    An imported run has no estimates of its own: without `out` they are kept in RUN/replays/<id>.
    Raises UsageError, ConfigurationError, NotARunError, StorageError.
    """
    reader = RunReader(run)
    recorded = load_configuration_text(reader.header.configuration_text, source=f"configuration of {run}")
    configuration = _configuration(reader, run, config, overrides)
    if verify:
        _check_comparable(reader, run, recorded, configuration, begin)
    start = begin.start(reader.header, reader.folder, configuration)
    folder = None
    if out is not None or reader.header.is_import:
        folder = reader.folder.new_replay(out)
    with nullcontext() if folder is None else folder.whole_or_gone():
        if folder is not None:
            folder.write_configuration(configuration.text)
        Estimator.warm_up(configuration.slam)
        if folder is not None and start is not None:
            start.keep_in(folder)
        result = replay(reader, configuration, folder, verify, progress, start=start)
        others = [*other_versions(reader.header.versions), *ignored_settings(reader.header.configuration_text)]
        if result.difference and others:
            result.difference += f" (recorded with other code: {'; '.join(others)})"
        summary = summarise_replay(result, str(run), folder, configuration.sha256)
        if folder is not None:
            folder.write_summary(summary)
    return summary


def summarise_replay(
    result: ReplayResult, run: str, folder: RunFolder | None, configuration_sha256: str
) -> dict[str, Any]:
    """The result as --json prints it."""
    return {
        "run": run,
        "out": None if folder is None else str(folder.path),
        "ticks": result.ticks,
        "scans": result.scans,
        "defects": result.defects,
        "defect": result.defect or None,
        "identical": result.identical,
        "compared": result.compared,
        "difference": result.difference or None,
        "truncated": result.truncated or None,
        "altered": result.altered,
        "other_processor": result.other_processor or None,
        "within_tolerance": result.within_tolerance,
        "deviation": result.deviation.sentence if result.other_processor else None,
        "recording_s": round(result.recording_s, 3),
        "elapsed_s": round(result.elapsed_s, 3),
        "times_real_time": round(result.recording_s / result.elapsed_s, 1) if result.elapsed_s > 0 else None,
        "step_ms": result.steps.spread(),
        "landmarks": result.landmarks,
        "configuration_sha256": configuration_sha256,
    }


def _configuration(reader: RunReader, run: Path, config: Path | None, overrides: Mapping[str, str]) -> Configuration:
    if config is not None:
        configuration = load_configuration(config, overrides)
        if not reader.header.is_import:
            return configuration
        recorded = load_configuration_text(reader.header.configuration_text, source=f"configuration of {run}")
        return load_configuration(config, mount_of_import(recorded, configuration) | dict(overrides))
    return load_configuration_text(reader.header.configuration_text, overrides, f"configuration of {run}")


def _check_comparable(
    reader: RunReader, run: Path, recorded: Configuration, configuration: Configuration, begin: BeginIn
) -> None:
    """Raises UsageError when the record cannot be what this replay has to give."""
    if reader.header.is_import:
        raise UsageError(f"{run} is imported and has no estimates to verify; replay it, then verify one of its replays")
    if (recorded.slam, recorded.seed) != (configuration.slam, configuration.seed):
        raise UsageError("--verify compares with the record: leave out --config, --set, --without and --seed")
    if begin != AS_RECORDED:
        raise UsageError("--verify compares with the record: leave out --map, --localise-only and --start-at")


def _writer(
    reader: RunReader, configuration: Configuration, out: RunFolder | None, start: RunStart | None
) -> RunWriter | None:
    if out is None:
        return None
    header = dataclasses.replace(
        reader.header,
        configuration_text=configuration.text,
        source=f"replay of {reader.folder.path.name}",
        versions=installed_versions(),
        start=start.metadata if start is not None else {},
    )
    return RunWriter(out.mcap_path, header.metadata, reader.attachments)


def _records(recorded: RecordedTick, estimate: Estimate, step_ns: int, state_hash: bytes, defect: str) -> list[Record]:
    """The tick as it stood, with the new outcome; lateness and missed beats remain those of the drive."""
    was = recorded.timing or Timing(0, 0, {})
    timing = Timing(was.lateness_ns, was.missed, {"step": step_ns})
    completed = CompletedTick(recorded.tick, estimate, timing, state_hash, None, defect)
    records = recorded.inputs + outcome_records(completed)
    return records + [truth for topic, truth in recorded.outcomes.items() if topic == "/truth"]


def _note(result: ReplayResult, recorded: RecordedTick, estimate: Estimate) -> None:
    if result.ticks == 0:
        result.first_stamp_ns = recorded.tick.stamp_ns
    result.last_stamp_ns = recorded.tick.stamp_ns
    result.ticks += 1
    result.scans += recorded.tick.scan is not None
    result.landmarks = int(estimate.counts.get("landmarks", result.landmarks))


def _compare(result: ReplayResult, recorded: RecordedTick, estimate: Estimate, state_hash: bytes) -> None:
    """Every byte of the recorded estimate, and the hash of the state."""
    lost = sum(gap.ticks for gap in recorded.gaps)
    if lost:
        result.difference = (
            f"tick {recorded.tick.seq}: the record lost {lost} ticks before it that the filter saw; "
            "from here on no replay can be identical"
        )
        return
    was = recorded.outcomes.get("/estimate")
    if was is None:
        return
    result.compared += 1
    if was.data == encode_estimate(estimate).data and recorded.state_hash == state_hash:
        return
    result.difference = first_difference(recorded, estimate, state_hash)


def replay_lines(summary: dict[str, Any]) -> list[str]:
    """The summary of a replay for a person."""
    step = summary["step_ms"]
    lines = [
        f"ticks     {summary['ticks']} with {summary['scans']} scans, {summary['recording_s']:.1f} s of recording",
        f"time      {summary['elapsed_s']:.1f} s, {summary['times_real_time']} times real time; "
        f"step p50 {step['p50']:.2f}  p99 {step['p99']:.2f}  max {step['max']:.2f} ms",
        f"landmarks {summary['landmarks']}",
    ]
    if summary["defects"]:
        lines.append(defects_line(summary["defects"], summary["ticks"], summary["defect"]))
    if summary["identical"] is not None:
        left = " of what is left" if summary["altered"] else ""
        same = f"identical to the record{left}, every bit of {summary['compared']} estimates and state hashes"
        differs = f"DIFFERS: {summary['difference']}"
        if summary["within_tolerance"] is not None:
            differs = f"other processor: {summary['other_processor']}; {summary['deviation']}; {summary['difference']}"
            differs = differs if summary["within_tolerance"] else f"DIFFERS ({differs})"
        lines.append(f"verify    {same if summary['identical'] else differs}")
    if summary["truncated"] is not None:
        lines.append(f"note      {summary['truncated']}")
    if summary["out"] is not None:
        lines.append(f"estimates {summary['out']}")
    return lines
