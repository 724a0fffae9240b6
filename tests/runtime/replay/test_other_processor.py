"""On a processor of another kind a replay is compared within a stated tolerance; on the same kind to the last bit."""

import dataclasses
import json
import math
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import ScanLike, WheelSample
from runtime.record.reader import RunReader
from runtime.replay import replay as replaying
from runtime.replay.difference import TOLERANCE_DEG, TOLERANCE_M, Deviation
from runtime.replay.replay import replay, replay_lines, summarise_replay
from runtime.service.processor import processor_facts
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


VERIFY = """
import json, pathlib, sys
from runtime.replay.replay import replay_run
from runtime.service.processor import processor_facts
print(json.dumps([replay_run(pathlib.Path(sys.argv[1]), None, None, True, {}), dict(processor_facts())]))
"""
DRIVE_S = 6.0  # of which it stands for two
ALL_OF_NUMPY = "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR X86_V3 X86_V4"


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
    seeded_facts(folder, 1, duration_s=DRIVE_S)
    return folder


@pytest.mark.parametrize(
    ("kind", "by_m", "within", "words"),
    [
        (
            "machine aarch64, here x86_64",
            1e-9,
            True,
            "other processor: machine aarch64, here x86_64; the pose differs by at most 1e-09 m",
        ),
        ("machine aarch64, here x86_64", 1.0, False, "DIFFERS (other processor"),
        ("", 1e-9, None, "DIFFERS: tick 0"),
        ("machine aarch64, here x86_64", 0.0, None, "identical to the record"),
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


@pytest.mark.skipif(platform.machine() != "x86_64", reason=f"a {platform.machine()} has no older kind to replay as")
@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("OPENBLAS_CORETYPE", "Nehalem"),
        ("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"),
        ("NPY_DISABLE_CPU_FEATURES", ALL_OF_NUMPY),
    ],
)
def test_a_library_with_code_for_an_older_processor_changes_no_bit_of_a_replay(
    run: Path, variable: str, value: str
) -> None:
    """Decision 49. Each of these changed the first ticks while a step still asked BLAS, libm and numpy's functions."""
    said = subprocess.run(
        [sys.executable, "-c", VERIFY, str(run)],
        env={**os.environ, variable: value},
        capture_output=True,
        text=True,
        check=True,
    )
    summary, facts = json.loads(said.stdout)
    assert summary["identical"], summary["difference"]
    assert summary["compared"] == 10 * DRIVE_S
    if "avx2" in facts["instructions"]:
        here = processor_facts()
        assert any(facts[name].split()[-1] != here[name].split()[-1] for name in ("blas", "libm")), (
            "it computed as here"
        )
