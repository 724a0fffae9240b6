"""The figures of a run as report.json holds them and the page shows them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.live.timekeeping import Durations
from runtime.map_files.changes import map_changes
from runtime.map_files.confirmed import confirmed
from runtime.report.events.repeated import repeated
from runtime.report.events.states import state_times
from runtime.report.facts import QUALITIES, RunFacts
from runtime.report.finding import Finding, silences, worst
from runtime.report.findings.geometry import geometry_rows
from runtime.report.judge import because, verdict

SHOWN_EVENTS = 100  # rows; the record has them all
FORMAT = 1


def figures(facts: RunFacts, findings: Sequence[Finding]) -> dict[str, Any]:
    """All of it; what is not known is None."""
    return {
        "format": FORMAT,
        "run": facts.name,
        "source": facts.source,
        "created_utc": facts.created_utc,
        "configuration_sha256": facts.configuration.sha256,
        "duration_s": round(facts.duration_s, 2),
        "verdict": verdict(findings),
        "because": because(findings),
        "severity": worst(findings).value,
        "findings": [finding.as_json() for finding in findings],
        "accuracy": facts.accuracy,
        "defects": {"steps": len(facts.defects), "first": facts.defects[0][1] if facts.defects else None},
        "health": _health(facts),
        "timing": _timing(facts),
        "sensors": _sensors(facts),
        "filter": _filter(facts),
        "landmarks": _landmarks(facts),
        "map_changes": _map_changes(facts),
        "recognitions": _recognitions(facts),
        "geometry": [asdict(row) for row in geometry_rows(facts)],
        "events": _events(facts),
        "truncated": facts.truncated or None,
    }


def _health(facts: RunFacts) -> list[dict[str, Any]]:
    """Each state with its seconds; empty where the run told nothing."""
    return [
        {
            "state": each.state,
            "seconds": round(each.seconds, 2),
            "share": round(each.share, 4),
            "spans_s": [[round(start, 2), round(end, 2)] for start, end in each.spans],
            "reasons_s": {reason: round(seconds, 2) for reason, seconds in each.reasons},
        }
        for each in state_times(facts.events, facts.origin_ns, facts.duration_s)
    ]


def _timing(facts: RunFacts) -> dict[str, Any]:
    ticks = facts.ticks
    rate_hz = (ticks.times_s.size - 1) / facts.duration_s if facts.duration_s > 0.0 else None
    return {
        "ticks": int(ticks.times_s.size),
        "missed": int(ticks.missed.sum()),
        "rate_hz": None if rate_hz is None else round(rate_hz, 3),
        "lateness_ms": _durations(ticks.lateness_ms),
        "stages_ms": {name: _durations(values) for name, values in ticks.stages_ms.items()},
    }


def _durations(durations_ms: NDArray[np.float64]) -> dict[str, float] | None:
    """As the run itself gave them at its end; None where nothing was recorded."""
    durations = Durations.of(durations_ms)
    return durations.spread() if len(durations) else None


def _sensors(facts: RunFacts) -> dict[str, Any]:
    valid = facts.wheels.times_s[facts.wheels.valid]
    return {
        "laser": {**_stream(facts.scans.times_s, facts.duration_s), "age_ms": spread(facts.scans.age_s * 1e3)},
        "wheels": {**_stream(valid, facts.duration_s), "invalid": int((~facts.wheels.valid).sum())},
    }


def _stream(times_s: FloatArray, duration_s: float) -> dict[str, Any]:
    steps = np.diff(times_s)
    rate_hz = round(float(1.0 / np.median(steps)), 2) if steps.size and np.median(steps) > 0 else None
    gaps = [[round(start, 2), round(end, 2)] for start, end in silences(times_s, duration_s, 0.5)]
    return {"samples": int(times_s.size), "usual_rate_hz": rate_hz, "gaps_s": gaps}


def _filter(facts: RunFacts) -> dict[str, Any]:
    ticks = facts.ticks
    shares = {word: round(float((ticks.quality == index).mean()), 4) for index, word in enumerate(QUALITIES)}
    return {
        "quality_share": shares,
        "position_sd_m": spread(ticks.position_sd_m),
        "particles_apart_m": spread(ticks.apart_m),
        "effective_particles": spread(ticks.counts.get("effective_particles", np.empty(0))),
        "features": spread(ticks.counts.get("features", np.empty(0))),
        "matched": spread(ticks.counts.get("matched", np.empty(0))),
    }


def _landmarks(facts: RunFacts) -> dict[str, Any]:
    counts = facts.ticks.counts
    last = counts.get("landmarks", np.zeros(1))
    known = last[np.isfinite(last)]
    return {
        "born": int(np.nansum(counts.get("created", np.zeros(1)))),
        "removed": int(np.nansum(counts.get("removed", np.zeros(1)))),
        "at_end": int(known[-1]) if known.size else 0,
        "published": 0 if facts.landmarks is None else len(facts.landmarks.identities),
        "confirmed": len(confirmed(facts.landmarks).identities),  # as `infant map draw` counts them
    }


def _recognitions(facts: RunFacts) -> list[dict[str, Any]]:
    """Each place that was recognised and each new map, with s since the first tick; odds are natural logarithms."""
    counts = facts.ticks.counts
    columns = {name: values for name, values in counts.items() if name.startswith("recognised_")}
    if "recognised_map_id" not in columns:
        return []
    found = []
    for row in np.flatnonzero(np.isfinite(columns["recognised_map_id"])).tolist():
        of = {name.removeprefix("recognised_"): float(values[row]) for name, values in columns.items()}
        mirror = of.get("mirror_odds", np.nan)
        found.append(
            {
                "time_s": round(float(facts.ticks.times_s[row]), 2),
                "map_id": int(of["map_id"]),
                "is_new": bool(of["is_new"]),
                "joined": int(of["joined"]),
                "by_scans": bool(of.get("by_scans", 0.0)),
                "matches": int(of["matches"]),
                "odds": round(of["odds"], 1),
                "mirror_odds": round(mirror, 1) if np.isfinite(mirror) else None,
                "moved_m": round(of["moved_m"], 3),
                "turned_deg": round(float(np.degrees(of["turned_rad"])), 1),
            }
        )
    return found


def _map_changes(facts: RunFacts) -> dict[str, Any] | None:
    """None for a run that began without a saved map."""
    if facts.known_map is None or facts.landmarks is None:
        return None
    changes = map_changes(facts.known_map, facts.landmarks)
    known = len(facts.known_map.identities)
    return {"known": known, "gone_m": changes.gone_m.round(3).tolist(), "new_m": changes.new_m.round(3).tolist()}


def _events(facts: RunFacts) -> dict[str, Any]:
    counted = Counter(f"{event.source}.{event.kind}" for event in facts.events)
    shown = [
        {
            "time_s": round(row.start_s, 2),
            "until_s": round(row.end_s, 2),
            "times": row.times,
            "source": row.event.source,
            "kind": row.event.kind,
            "severity": row.event.severity.value,
            "reason": row.event.reason,
        }
        for row in repeated(facts.events, facts.origin_ns)[:SHOWN_EVENTS]
    ]
    return {"total": len(facts.events), "by_kind": dict(counted.most_common()), "first": shown}


def spread(values: NDArray[np.float64]) -> dict[str, float] | None:
    """Median, 99th percentile and largest; None where there is nothing."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    p50, p99 = np.percentile(known, (50.0, 99.0))
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4), "max": round(float(known.max()), 4)}
