"""A rover that is carried: what its wheels and its laser say meanwhile is no word on its geometry."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime.report.facts import QUALITIES, RunFacts
from runtime.report.judge import judge
from runtime.report.wheel_calibration import calibrated
from tests.support.runtime.seeded_runs import Draft, between, seeded_facts

PUT_DOWN_S = 8.0
UNTIL_S = 24.0


def _pushed(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """From then on the left wheel turns backwards, as when people hold and push the rover."""
    held = next(draft.wheels[-1].left for draft in drafts if draft.wheels and between(draft, PUT_DOWN_S, 99.0))
    return [
        replace(d, wheels=tuple(replace(s, left=2.0 * held - s.left) for s in d.wheels))
        if between(d, PUT_DOWN_S, UNTIL_S)
        else d
        for d in drafts
    ]


def _lost(facts: RunFacts, rise_s: float) -> RunFacts:
    """The same, lost from then on; the doubt rises within rise_s."""
    ticks = facts.ticks
    score = np.clip((ticks.times_s - PUT_DOWN_S) / rise_s, 0.0, 1.0) * 27.0
    quality = np.where(score >= 18.0, QUALITIES.index("lost"), ticks.quality)
    return replace(facts, ticks=replace(ticks, counts={**ticks.counts, "doubt_score": score}, quality=quality))


def test_a_rover_that_was_carried_is_not_said_to_have_wrong_wheels(tmp_path: Path) -> None:
    facts = seeded_facts(tmp_path / "run", 3, fault=_pushed, duration_s=UNTIL_S)
    kinds = {finding.kind for finding in judge(calibrated(_lost(facts, 6.0)))}
    assert "wheels_laser_disagree" in kinds, "nothing says that it was carried"
    carried = _lost(facts, 1e-9)
    ((start_s, end_s),) = carried.carried_spans()
    assert start_s < PUT_DOWN_S < end_s
    found = {finding.kind: finding for finding in judge(calibrated(carried))}
    assert "wheels_laser_disagree" not in found
    assert "was carried, pushed or lifted" in found["pose_lost"].cause
