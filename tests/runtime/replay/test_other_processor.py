"""On a processor of another kind a replay is compared within a stated tolerance; on the same kind to the last bit."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import ScanLike, WheelSample
from runtime.record.reader import RunReader
from runtime.replay import replay as replaying
from runtime.replay.difference import TOLERANCE_DEG, TOLERANCE_M, Deviation
from runtime.replay.replay import replay, replay_lines, summarise_replay
from runtime.settings.configuration import load_configuration_text
from slam.estimate import Estimate
from slam.estimator import Estimator
from slam.pose import Pose2
from slam.recognise.prior import PosePrior
from tests.support.runtime.recorded_values import make_estimate
from tests.support.runtime.seeded_runs import seeded_facts


@pytest.mark.parametrize(
    ("moved", "allowed"),
    [
        ((0.5 * TOLERANCE_M, 0.0, 0.0), True),
        ((2.0 * TOLERANCE_M, 0.0, 0.0), False),
        ((0.0, 0.0, math.radians(0.5 * TOLERANCE_DEG) + math.tau), True),
        ((0.0, 0.0, math.radians(2.0 * TOLERANCE_DEG)), False),
        ((math.nan, 0.0, 0.0), False),
        ((0.0, 0.0, math.inf), False),
    ],
)
def test_a_deviation_is_allowed_up_to_the_tolerance(moved: tuple[float, float, float], allowed: bool) -> None:
    class Recorded:
        estimate = make_estimate(0, np.random.default_rng(1))

    was = Recorded.estimate.map_from_body
    now = Pose2(was.x_m + moved[0], was.y_m + moved[1], was.heading_rad + moved[2])
    deviation = Deviation()
    deviation.note(Recorded, dataclasses.replace(Recorded.estimate, map_from_body=now))  # type: ignore[arg-type]
    assert deviation.is_allowed == allowed


class Nudged(Estimator):
    """An estimator whose arithmetic differs."""

    by_m = 1e-9

    def step(
        self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
    ) -> Estimate:
        estimate = super().step(stamp_ns, scan, wheels)
        pose = estimate.map_from_body
        return dataclasses.replace(estimate, map_from_body=Pose2(pose.x_m + self.by_m, pose.y_m, pose.heading_rad))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drive") / "run"
    seeded_facts(folder, 1, duration_s=1.5)
    return folder


@pytest.mark.parametrize(
    ("kind", "by_m", "within", "words"),
    [
        (
            "blas Zen, here Haswell",
            1e-9,
            True,
            "other processor: blas Zen, here Haswell; the pose differs by at most 1e-09 m",
        ),
        ("blas Zen, here Haswell", 1.0, False, "DIFFERS (other processor"),
        ("", 1e-9, None, "DIFFERS: tick 0"),
        ("blas Zen, here Haswell", 0.0, None, "identical to the record"),
    ],
)
def test_the_kind_of_the_processor_decides_what_a_difference_means(
    run: Path, monkeypatch: pytest.MonkeyPatch, kind: str, by_m: float, within: bool | None, words: str
) -> None:
    monkeypatch.setattr(replaying, "other_kind", lambda recorded, here: kind)
    monkeypatch.setattr(Nudged, "by_m", by_m)
    reader = RunReader(run)
    configuration = load_configuration_text(reader.header.configuration_text)
    result = replay(reader, configuration, verify=True, estimator_factory=Nudged)
    summary = summarise_replay(result, "run", None, "")
    assert summary["within_tolerance"] is within
    assert any(words in line for line in replay_lines(summary)), replay_lines(summary)
