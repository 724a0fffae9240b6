"""Hours of driving in minutes, with everything that a run has; what it holds must not grow, and no beat is missed.

The loop, both drivers, recorder, drawing and zenoh are those of `infant run`. The clock is not: it skips the time in
which the loop sleeps (LeapingClock). The simulated rover lives by the same clock (SteppedRover): it sends SCIP over TCP
and CAN frames over python-can's virtual bus, and time goes on when the drivers have taken them. No faults are injected.
"""

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from runtime.errors import ConfigurationError, Interrupted
from runtime.live.clock import Clock
from runtime.live.drawing_process import ReviewProcess
from runtime.live.parts import Parts, live_parts
from runtime.live.run import Host, run_live
from runtime.record.check import verify_run
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.record.reader import RunReader
from runtime.replay.replay import ReplayResult, replay
from runtime.review.viewer import free_port
from runtime.service.systemd import ServiceManager
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.settings.overrides import key_values
from runtime.studies.soak.clock import LeapingClock
from runtime.studies.soak.listener import Listener
from runtime.studies.soak.process_sampler import ProcessSampler, Sample, fitted_growth, open_files, settled
from runtime.studies.soak.rover import SteppedRover

BUDGET_GB = 0.2
WHOLE_REPLAY_S = 600.0  # a longer drive is replayed over its last segment only
GROWTH_MAX_MB = 5.0
RESIDENT_MAX_MB = 300.0
SAMPLES_MIN = 20
MINUTE_S = 60.0


def soak(
    config: Path, minutes: float, speed: float, out: Path, overrides: list[str], stop: threading.Event, stream: TextIO
) -> dict[str, Any]:
    """Drive minutes * speed minutes of the loop's clock, at most `speed` times faster than life; all figures of it.

    out: folder that gets the run; its other runs count into the budget of the record. Raises ConfigurationError,
    StorageError, SensorError, Interrupted.
    """
    configuration = soak_configuration(config, overrides)
    folder = RunFolder.create(out / "run", out)
    driven_s = MINUTE_S * minutes * speed
    beats = round(driven_s * configuration.loop.rate_hz)
    track = ProcessSampler(min(MINUTE_S, driven_s / SAMPLES_MIN), beats - 1)
    open_before = open_files()
    with stepped(configuration, speed) as (rover, clock):
        wired = configuration.model_copy(update={"laser": rover.laser, "encoders": rover.encoders, "simulation": None})
        sinks: dict[str, Any] = {}

        def wire(configuration: Configuration, folder: RunFolder, clock: Clock) -> Parts:
            parts = live_parts(configuration, folder, clock)
            rover.meet(parts.laser, parts.encoders, parts.sinks)
            drawing = parts.sinks.get("review")
            track.drawing = drawing if isinstance(drawing, ReviewProcess) else None
            sinks.update(parts.sinks)
            listener.await_subscribed()
            return replace(parts, rover=rover, sinks={**parts.sinks, "soak": track})

        listener = Listener(configuration.publish.listen[0])
        real_s = -os.times().elapsed
        try:
            host = Host(clock, stop, stream, ServiceManager(""))
            summary = run_live(wired, folder, host, driven_s, wire)
        finally:
            real_s += os.times().elapsed
            heard = listener.heard()
    if not track.samples:
        folder.remove()
        raise Interrupted("stopped before there was anything to measure; nothing is kept")
    left_open = open_files() - open_before
    return {
        "minutes_asked": minutes,
        "speed_asked": speed,
        "driven_s": round(summary["ticks"] / summary["rate_hz"], 1),
        "real_s": round(real_s, 1),
        "load": [round(load, 2) for load in os.getloadavg()],
        "not_taken": rover.not_taken,
        "waited_for_sinks_s": round(rover.waited_s, 1),
        "left_open": dict(left_open),
        "garbage": track.garbage,
        "missed_by_itself": track.missed_by_itself,
        **process_figures(track.samples),
        "sinks": {name: asdict(sink.health()) for name, sink in sinks.items()},
        "heard": heard,
        **record_figures(folder),
        "summary": summary,
        "samples": [asdict(sample) for sample in track.samples],
    }


def soak_configuration(config: Path, overrides: list[str]) -> Configuration:
    """The file's own, with a budget for the record and without privileges, which time that is skipped has no use for.

    Raises ConfigurationError where no rover is simulated.
    """
    given = key_values(overrides)
    wanted = {"record.budget_gb": str(BUDGET_GB)} | given
    fixed = {
        "loop.priority": "0",
        "publish.enabled": "true",
        "publish.connect": "[]",
        "publish.listen": f'["tcp/127.0.0.1:{free_port()}"]',
    }
    configuration = load_configuration(config, wanted | fixed)
    if configuration.simulation is None or configuration.laser is None or configuration.encoders is None:
        raise ConfigurationError(f"{config}: needs [simulation], [laser] and [encoders]; see config/mock.toml")
    return configuration


@contextmanager
def stepped(configuration: Configuration, speed: float) -> Iterator[tuple[SteppedRover, LeapingClock]]:
    """The rover and the clock by which it lives."""
    assert configuration.simulation is not None
    assert configuration.laser is not None
    assert configuration.encoders is not None
    clock = LeapingClock(speed, lambda deadline_ns, leap: rover.live_until(deadline_ns, leap))
    rover = SteppedRover(configuration.simulation, configuration.laser, configuration.encoders, clock.now_ns)
    try:
        yield rover, clock
    finally:
        rover.close()


def process_figures(samples: list[Sample]) -> dict[str, Any]:
    """Growth of what the process held, from the first tenth of the drive to its end."""
    late = settled(samples)
    third = max(1, len(late) // 3)
    first, last = late[:third], late[-third:]
    return {
        "resident_mb": {"settled": round(late[0].resident_mb, 2), "end": round(late[-1].resident_mb, 2)},
        "growth_mb": {
            "end_minus_settled": round(late[-1].resident_mb - late[0].resident_mb, 2),
            "fitted": round(fitted_growth(late, [sample.resident_mb for sample in late]), 2),
            "heap_fitted": round(fitted_growth(late, [sample.heap_mb for sample in late]), 2),
        },
        "blocks_grown": round(fitted_growth(late, [sample.blocks for sample in late])),
        "descriptors_grown": int(np.median([s.descriptors for s in last]) - np.median([s.descriptors for s in first])),
        "threads_grown": int(np.median([s.threads for s in last]) - np.median([s.threads for s in first])),
        "landmarks": {"settled": late[0].landmarks, "end": late[-1].landmarks},
        "kept_waiting_s": round(samples[-1].kept_waiting_s - samples[0].kept_waiting_s, 2),
        "drawing_max_mb": round(max(sample.drawing_mb for sample in samples), 1),
    }


def record_figures(folder: RunFolder) -> dict[str, Any]:
    """What the disk holds, read again: all that is left verified, and stepped through the filter once more.

    A short drive is compared with its record to the last bit; of a long one the last segment is driven anew.
    """
    verified = verify_run(folder.path)
    manifest = Manifest.load(folder.manifest_path)
    reader = RunReader(folder.path)
    whole = not manifest.removed and verified.ticks * 0.1 <= WHOLE_REPLAY_S
    replayed = _replay(folder.path, True) if whole else _replay_last(folder)
    return {
        "segments": {"closed": len(manifest.segments), "removed": len(manifest.removed), "left": verified.segments},
        "verified_ticks": verified.ticks,
        "damages": verified.damages,
        "gaps": [gap for gap in verified.gaps if "removed for room" not in gap],
        "replayed": {"whole": whole, "ticks": replayed.ticks, "identical": replayed.identical},
        "run": str(reader.folder.path),
    }


def _replay_last(folder: RunFolder) -> ReplayResult:
    """The newest closed segment as a run of its own."""
    newest = list(folder.closed_segments().values())[-1]
    with tempfile.TemporaryDirectory(prefix="infant-soak-", dir=folder.path) as name:
        os.link(newest, Path(name) / "run.mcap")
        return _replay(Path(name), False)


def _replay(run: Path, verify: bool) -> ReplayResult:
    reader = RunReader(run)
    return replay(reader, load_configuration_text(reader.header.configuration_text), None, verify)


def soak_lines(measured: dict[str, Any]) -> list[str]:
    """Each figure beside what it must be."""
    summary, growth = measured["summary"], measured["growth_mb"]
    largest, held = max(growth.values()), measured["resident_mb"]["end"]
    leaked = max(measured["descriptors_grown"], sum(measured["left_open"].values()))
    own = measured["missed_by_itself"]
    driven, damages = measured["driven_s"], len(measured["damages"]) + len(measured["gaps"])
    rows = [
        ("memory growth", f"{largest:.2f} MB", f"below {GROWTH_MAX_MB:g} MB", largest < GROWTH_MAX_MB),
        ("memory", f"{held:.0f} MB", f"below {RESIDENT_MAX_MB:g} MB", held < RESIDENT_MAX_MB),
        ("descriptors", f"{leaked} leaked", "0", leaked <= 0),
        ("garbage", f"{measured['garbage']} objects", "0", measured["garbage"] == 0),
        ("missed beats", str(summary["missed"]), "0", summary["missed"] == 0),
        ("damages", str(damages), "0", damages == 0),
    ]
    memory, replayed = measured["resident_mb"], measured["replayed"]
    sinks = "; ".join(f"{name} dropped {sink['dropped']}" for name, sink in measured["sinks"].items())
    return [
        f"{driven / 3600.0:.2f} h of driving in {measured['real_s'] / MINUTE_S:.1f} min: "
        f"{driven / measured['real_s']:.1f} times faster than real time, load {measured['load'][0]}",
        *(f"{name:14s} {value:>12s}  must be {must:12s} {'ok' if ok else 'NOT MET'}" for name, value, must, ok in rows),
        f"memory {memory['settled']} MB after a tenth of it, {memory['end']} MB at the end, growth {growth}, "
        f"small objects {measured['blocks_grown']:+d}",
        f"threads grown {measured['threads_grown']}, drawing process at most {measured['drawing_max_mb']} MB",
        f"ticks {summary['ticks']}, landmarks {measured['landmarks']['settled']} to {measured['landmarks']['end']}, "
        f"SLAM {summary['slam_rms_m']} m RMS",
        f"threads waited {measured['kept_waiting_s']} s for a processor; {own} beats were missed though they had one; "
        f"the clock waited {measured['waited_for_sinks_s']} s for sinks and {measured['not_taken']} times for a driver",
        f"{sinks}; messages heard over zenoh {sum(measured['heard'].values())}",
        f"segments {measured['segments']}, {measured['verified_ticks']} ticks verified, replayed {replayed}",
    ]
