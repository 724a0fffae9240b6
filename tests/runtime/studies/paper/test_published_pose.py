import pytest

from runtime.studies.paper.drives.arms import NORMAL, PROPOSED, RANGE_GATED
from runtime.studies.paper.drives.blind_step import blind_step
from runtime.studies.paper.drives.feature_drive import feature_drive
from runtime.studies.paper.page import report_lines
from runtime.studies.paper.published_pose import published_lines, published_rows, unscented_rows
from runtime.studies.paper.study import Cell, comparison_rows, spread_rows


def result(**figures: float) -> dict[str, float]:
    return figures


def test_the_range_gate_of_normal_estimation_changes_nothing_but_the_work() -> None:
    normal, gated = (feature_drive("V2", 1, arm, 3, False, "test", 110) for arm in (NORMAL, RANGE_GATED))
    for name in ("landmarks", "particles_largest_m", "particles_aligned_rms_m"):
        assert gated[name] == normal[name]
    assert gated["likelihoods"] < 0.2 * normal["likelihoods"]


def test_the_unscented_proposal_wins_where_a_step_is_strongly_nonlinear() -> None:
    name = "particles_error_30deg_m"
    unscented, ekf = ([blind_step(seed, arm, 10, "test")[name] for seed in range(6)] for arm in (PROPOSED, "ekf"))
    assert sum(unscented) < 0.9 * sum(ekf)


def test_one_landmark_at_a_time_gives_finite_figures_better_than_odometry() -> None:
    figures = feature_drive("LONELY", 0, PROPOSED, 5, False, "test")
    assert figures["not_finite"] == 0
    assert figures["published_largest_m"] < figures["odometry_largest_m"]


def test_every_figure_says_whether_it_is_what_was_asked_for() -> None:
    outcomes = {
        Cell("P", PROPOSED, 30): [result(published_largest_m=value, nees_median=0.5) for value in (0.8, 0.9, 0.7)],
        Cell("V2", PROPOSED, 30): [result(published_largest_m=0.2), result(published_largest_m=0.4)],
        Cell("V2", RANGE_GATED, 30): [result(particles_largest_m=2.0), result(particles_largest_m=4.0)],
    }
    rows = published_rows(spread_rows(outcomes), comparison_rows(outcomes))
    reached = {(row["world"], row["what"]): (round(row["value"], 6), row["reached"]) for row in rows}
    assert reached == {
        ("P", "published pose, largest error, m"): (0.8, "must"),
        ("P", "median NEES of the published pose"): (0.5, "not reached"),
        ("V2", "published pose, largest error over that of normal estimation with a range gate"): (0.1, "aim"),
        ("V2", "published pose, largest error, m"): (0.3, "aim"),
    }
    text = "\n".join(published_lines(rows, []))
    assert "0.8 [0.7, 0.9]  must 1, aim 0.6: must" in text


def test_the_worst_seed_is_one_of_the_figures() -> None:
    name = "published_aligned_trimmed_rms_m"
    outcomes = {Cell("victoria_park", PROPOSED, 10): [result(**{name: value}) for value in (1.0, 1.2, 5.0)]}
    rows = {row["statistic"]: row for row in published_rows(spread_rows(outcomes), comparison_rows(outcomes))}
    assert (rows["median"]["value"], rows["median"]["reached"]) == (1.2, "aim")
    assert (rows["worst"]["value"], rows["worst"]["reached"]) == (5.0, "not reached")


@pytest.mark.parametrize(
    ("ekf", "verdict"),
    [((1.2, 1.3), "unscented is better"), ((0.8, 0.9), "unscented is worse"), ((0.9, 1.2), "no difference")],
)
def test_unscented_against_ekf_is_judged_by_the_whole_paired_interval(ekf: tuple[float, float], verdict: str) -> None:
    outcomes = {
        Cell("V2", PROPOSED): [result(particles_largest_m=1.0, landmarks=3), result(particles_largest_m=1.0)],
        Cell("V2", "ekf"): [result(particles_largest_m=value, landmarks=4) for value in ekf],
    }
    rows = unscented_rows(comparison_rows(outcomes))
    assert [(row["quantity"], row["verdict"]) for row in rows] == [("particles_largest_m", verdict)]


def test_the_page_has_every_figure_with_its_interval_and_the_ablation() -> None:
    outcomes = {
        Cell("P", PROPOSED, 30): [result(published_largest_m=value) for value in (0.8, 0.9, 0.7)],
        Cell("V2", PROPOSED): [result(landmarks=value) for value in (180, 170)],
        Cell("V2", "without density"): [result(landmarks=value) for value in (190, 190)],
    }
    spreads, comparisons = spread_rows(outcomes), comparison_rows(outcomes)
    study = {"parts": ["published"], "seeds": 3, "particles": 10, "claims": [], "not_given_in_the_paper": ["K"]}
    rows = {"published": published_rows(spreads, comparisons), "unscented": [], "comparisons": comparisons}
    page = "\n".join(report_lines(study | rows))
    assert "| published pose, largest error, m | start pose | P | 30 | 3 | mean | 0.8 [0.7, 0.9] | 1 | 0.6 |" in page
    assert "| without density | 2 |  |  | +15.00 [+10.00, +20.00] |" in page


def test_a_figure_without_a_random_part_says_so_beside_the_spread_of_what_is_left_out() -> None:
    name = "published_aligned_trimmed_rms_m"
    outcomes = {
        Cell("victoria_park", PROPOSED, 10): [result(**{name: 1.4})] * 3,
        Cell("victoria_park", PROPOSED, 10, 0.05): [result(**{name: value}) for value in (1.3, 1.5, 1.7)],
    }
    rows = {"published": published_rows(spread_rows(outcomes), []), "unscented": [], "comparisons": []}
    page = "\n".join(
        report_lines({"parts": [], "seeds": 3, "particles": 10, "claims": [], "not_given_in_the_paper": []} | rows)
    )
    assert "| victoria_park | 10 | 3 | median | 1.4 (the same in every seed) |" in page
    assert "| victoria_park, 5 % left out | 10 | 3 | median | 1.5 [1.3, 1.7] |" in page


def test_one_bad_seed_in_twenty_shows_as_the_worst_and_leaves_the_median() -> None:
    values = [result(published_aligned_rms_m=0.2, nees_median=2.0)] * 19
    values.append(result(published_aligned_rms_m=2.0, nees_median=128.0))
    outcomes = {Cell("mrclam_d6_r1, identities withheld", PROPOSED, left_out=0.05): values}
    rows = {(row["what"], row["statistic"]): row["value"] for row in published_rows(spread_rows(outcomes), [])}
    assert rows["published pose, RMS, m", "worst"] == 2.0
    assert rows["median NEES of the published pose", "median"] == 2.0
    assert rows["median NEES of the published pose", "mean"] == pytest.approx(8.3)
