from pathlib import Path

import numpy as np
import pytest

from runtime.studies.jobs import Job, run_jobs
from runtime.studies.paper.claims import claims, verdict_of_ratio
from runtime.studies.paper.drives.arms import ablation_arms, arm_settings
from runtime.studies.paper.drives.feature_drive import feature_drive, feature_settings
from runtime.studies.paper.reproduce import reproduce
from runtime.studies.paper.spread import compare, spread
from runtime.studies.paper.study import Cell, Study, comparison_rows, run_study, spread_rows
from runtime.studies.paper.tables import table1_rows

STEPS = 110


def drive(arm: str) -> dict[str, float]:
    return feature_drive("V2", 0, arm, 3, False, "test", STEPS)


def ignore(_done: int, _total: int) -> None: ...


def test_the_techniques_save_nine_tenths_of_the_likelihoods_and_most_landmarks() -> None:
    proposed, normal = drive("proposed"), drive("normal")
    assert proposed["likelihoods"] < 0.1 * normal["likelihoods"]
    assert proposed["landmarks"] < 0.5 * normal["landmarks"]


def test_normal_estimation_has_every_technique_off_and_the_ablation_changes_one_of_them() -> None:
    def switches(arm: str) -> list[bool]:
        return list(feature_settings(arm, 3).techniques.model_dump().values())

    assert not any(switches("normal"))
    assert [sum(switches(arm)) for arm in ablation_arms()] == [5] * 6 + [2, 2, 2, 2, 2, 1]
    with pytest.raises(ValueError, match="not an arm"):
        arm_settings("without luck")


def test_this_process_and_a_cluster_give_the_same_figures(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra: cluster")
    arguments = {"kind": "P", "seed": 1, "arm": "proposed", "particles": 3, "keep_paths": True, "code": "test"}
    jobs = [Job(feature_drive, {**arguments, "steps": 40})]
    here, there = (run_jobs(jobs, tmp_path / str(at), at, ignore)[0] for at in (None, "local"))
    for result in (here, there):
        for name in ("filter_cpu_s", "joint_cpu_s"):  # time differs from run to run
            result.pop(name)
    assert here == there


def test_a_study_compares_by_seed_and_sets_the_published_pose_against_normal_particles(tmp_path: Path) -> None:
    outcomes = run_study(Study(("table1",), seeds=2, particles=2, steps=30), tmp_path, None, ignore)
    assert {len(results) for results in outcomes.values()} == {2}
    rows = {(row["world"], row["quantity"]): row for row in comparison_rows(outcomes) if row["against"] == "normal"}
    normal, proposed = (outcomes[Cell("V2", arm)] for arm in ("normal", "proposed"))
    differences = [
        ours["published_largest_m"] - theirs["particles_largest_m"]
        for ours, theirs in zip(proposed, normal, strict=True)
    ]
    assert rows["V2", "published_largest_m"]["difference"] == pytest.approx(np.mean(differences))


def test_an_arm_with_fewer_seeds_is_compared_on_those_that_it_has() -> None:
    few = [{"landmarks": value} for value in (10.0, 30.0)]
    many = [{"landmarks": value} for value in (5.0, 15.0, 400.0)]
    (row,) = comparison_rows({Cell("V2", "proposed"): many, Cell("V2", "normal"): few}, ("normal",))
    assert (row["seeds"], row["ratio"]) == (2, 0.5)


def test_pairing_takes_out_what_the_seeds_have_in_common() -> None:
    seeds = np.random.default_rng(3).uniform(1.0, 9.0, 20)
    paired = compare(seeds + 0.5, seeds)
    assert paired.difference == pytest.approx(0.5)
    assert paired.difference_high - paired.difference_low < 1e-9
    assert spread(seeds).mean_high - spread(seeds).mean_low > 0.5


def test_a_verdict_follows_the_whole_interval() -> None:
    assert verdict_of_ratio(0.1, 0.19, 0.2) == "holds"
    assert verdict_of_ratio(0.21, 0.4, 0.2) == "does not hold"
    assert verdict_of_ratio(0.1, 0.4, 0.2) == "undecided"


def test_few_seeds_decide_nothing(tmp_path: Path) -> None:
    outcomes = run_study(Study(("table1",), seeds=1, particles=2, steps=30), tmp_path, None, ignore)
    found = claims(outcomes, comparison_rows(outcomes))
    assert found
    assert {claim.verdict for claim in found} == {"undecided"}


def test_a_claim_with_many_seeds_is_decided_beside_one_with_few() -> None:
    many, few = [{"landmarks": 20.0, "likelihoods": 1.0}] * 6, [{"landmarks": 90.0, "likelihoods": 250.0}] * 6
    outcomes = {
        Cell("P", "proposed"): many,
        Cell("P", "normal"): few,
        Cell("V2", "proposed"): many,
        Cell("V2", "normal"): few[:5],
    }
    found = {(claim.where, claim.paper[:3]): claim for claim in claims(outcomes, comparison_rows(outcomes))}
    assert {place: (claim.verdict, claim.seeds) for place, claim in found.items()} == {
        ("P", "627"): ("holds", 6),
        ("P", "no "): ("holds", 6),
        ("V2", "627"): ("undecided", 5),
        ("V2", "no "): ("undecided", 5),
    }
    assert "-99.6 %" in found["P", "no "].here
    assert "fewer than 6 seeds" in found["V2", "627"].here
    assert "fewer than 6 seeds" not in found["P", "627"].here


def test_a_recording_that_runs_once_is_judged_by_the_seeds_that_leave_something_out() -> None:
    figures = [{"particles_aligned_rms_m": 0.2, "odometry_aligned_rms_m": 2.0}]
    outcomes = {
        Cell("mrclam_d6_r1", "proposed", most_seeds=1): figures,
        Cell("mrclam_d6_r1", "proposed", left_out=0.05): figures * 20,
        Cell("victoria_park", "proposed", 10): figures * 20,
        Cell("victoria_park", "proposed", 10, left_out=0.05): figures * 20,
    }
    found = {claim.where: (claim.seeds, claim.verdict) for claim in claims(outcomes, [])}
    assert found == {
        "mrclam_d6_r1, proposed, 5 % left out": (20, "holds"),
        "victoria_park, proposed, 10 particles": (20, "holds"),
    }


def test_the_table_has_one_row_for_each_arm_whatever_else_ran_in_its_world() -> None:
    outcomes = {
        Cell("P", "proposed"): [{"landmarks": 170.0}],
        Cell("P", "proposed", 100): [{"landmarks": 190.0}],
        Cell("P", "normal"): [{"landmarks": 480.0}],
    }
    rows = table1_rows(spread_rows(outcomes))
    assert [(row["arm"], row["mean"], row["paper"]) for row in rows] == [
        ("proposed", 170.0, 213),
        ("normal", 480.0, 627),
    ]


def test_a_study_leaves_pictures_tables_and_a_page_with_every_claim_behind(tmp_path: Path) -> None:
    result = reproduce(Study(("table1",), seeds=1, particles=2, steps=30), tmp_path, None, ignore)
    assert all(Path(picture).stat().st_size > 5000 for picture in result["pictures"])
    assert (tmp_path / "table1.csv").read_text().startswith("paper,world,arm,particles")
    page = (tmp_path / "results.md").read_text()
    assert all(claim["here"] in page for claim in result["claims"])
    assert "| undecided |" in page
    assert "- alpha, beta, kappa of the unscented transform" in page
