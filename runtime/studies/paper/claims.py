"""What the paper says, what was found here, and whether it holds: computed from the figures, never written down."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from runtime.studies.files import Row
from runtime.studies.paper.spread import spread
from runtime.studies.paper.study import OUTDOOR, PRINTED, Cell, Outcomes, column

Verdict = Literal["holds", "does not hold", "undecided"]

OURS = (
    "M_c, K and the floor of the density threshold",
    "the particle count",
    "odometry and measurement noise",
    "alpha, beta, kappa of the unscented transform",
    "existence increments and bounds",
    "the difference threshold",
    "the likelihood of a feature that matches nothing",
    "the worlds, the courses and the simulated outdoor drive",
    "in the worlds of features a spacing of 0.75 m (0.10 m on scans, as printed)",
    "and there the vote: seen within 0.7 m in half of the last five scans",
)
LEAST_SEEDS = 6  # bootstrap intervals of fewer are too narrow to decide anything


@dataclass(frozen=True, slots=True)
class Claim:
    """One sentence of the paper beside what was measured."""

    where: str
    paper: str
    here: str
    verdict: Verdict
    seeds: int

    def row(self) -> dict[str, str | int]:
        """For a table."""
        return asdict(self)

    @property
    def sentence(self) -> str:
        """In plain words."""
        return f"{self.where}: the paper says {self.paper}; here {self.here}: {self.verdict}"


def verdict_of_ratio(low: float, high: float, limit: float) -> Verdict:
    """Whether a ratio with this interval is at most the limit."""
    if high <= limit:
        return "holds"
    return "does not hold" if low > limit else "undecided"


def ratio_claim(row: Row, paper: str, limit: float, what: str) -> Claim:
    """A claim "at most so many times", from one row of comparison."""
    change = f"{what} changes by {_percent(row['ratio'])} % [{_percent(row['ratio_low'])}, "
    change += f"{_percent(row['ratio_high'])}] over {row['seeds']} seeds"
    verdict = verdict_of_ratio(row["ratio_low"], row["ratio_high"], limit)
    return Claim(row["world"], paper, change, verdict, row["seeds"])


def _percent(ratio: float) -> str:
    """Change in percent; -99.6 is not rounded to all."""
    return f"{100 * (ratio - 1):+.{0 if ratio > 0.01 else 1}f}"


def claims(outcomes: Outcomes, comparisons: Iterable[Row]) -> list[Claim]:
    """Every claim for which there are figures; those of few seeds are undecided, whatever the others have."""
    found = []
    for row in comparisons:
        key: tuple[Any, ...] = (row["arm"], row["against"], row["quantity"])
        match key:
            case ("proposed", "normal", "particles_largest_m"):
                found.append(ratio_claim(row, "the largest error falls by 80 %", 0.2, "that of the particles"))
            case ("proposed", "normal", "published_largest_m"):
                found.append(ratio_claim(row, "the largest error falls by 80 %", 0.2, "that of the published pose"))
            case ("proposed", "only range", "particles_largest_m" | "published_largest_m") if row["particles"]:
                whose = "the particles" if "particles" in row["quantity"] else "the published pose"
                what = f"that of {whose} ({row['particles']} particles; normal estimation with a range gate, which "
                what += "changes nothing but its time)"
                found.append(ratio_claim(row, "the largest error falls by 80 %", 0.2, what))
            case ("proposed", "normal", "landmarks"):
                found.append(ratio_claim(row, "627 landmarks become 213, -66 %", 213 / 627, "the number of landmarks"))
            case ("proposed", "normal", "filter_cpu_s"):
                found.append(ratio_claim(row, "time falls from 643 to 109, -83 %", 109 / 643, "CPU time of the filter"))
            case ("proposed", "normal", "likelihoods"):
                aim = "no figure (aim of this project: -90 %)"
                found.append(ratio_claim(row, aim, 0.1, "the number of likelihoods"))
            case ("ekf", "proposed", "particles_largest_m" | "particles_aligned_trimmed_rms_m"):
                found.append(_unscented_claim(row))
    found += _feature_claims(outcomes) + _odometry_claims(outcomes)
    return [claim if claim.seeds >= LEAST_SEEDS else _undecided(claim) for claim in found]


def _undecided(claim: Claim) -> Claim:
    return replace(claim, verdict="undecided", here=f"{claim.here} (fewer than {LEAST_SEEDS} seeds)")


def _unscented_claim(row: Row) -> Claim:
    """The difference is EKF minus unscented: above zero, the unscented one is better."""
    low, high = row["difference_low"], row["difference_high"]
    here = f"the EKF's error is larger by {row['difference']:+.3f} m [{low:+.3f}, {high:+.3f}] ({row['quantity']}) "
    here += f"over {row['seeds']} seeds"
    verdict: Verdict = "holds" if low > 0 else "does not hold" if high < 0 else "undecided"
    return Claim(row["world"], "the unscented proposal is more accurate than the EKF's", here, verdict, row["seeds"])


def _feature_claims(outcomes: Outcomes) -> list[Claim]:
    found = []
    for world in (OUTDOOR, PRINTED):
        results = outcomes.get(Cell(world, "proposed"))
        if results is None:
            continue
        apart = column(results, "least_spacing_m").min()
        near = f"the nearest two are {apart:.3f} m apart, of all scans of {len(results)} seeds"
        verdict: Verdict = "holds" if apart >= 0.0995 else "does not hold"  # float32 ranges
        found.append(Claim(world, "features are at least 0.10 m apart", near, verdict, len(results)))
        share = spread(column(results, "moving_created_share"))
        says = f"{100 * share.mean:.1f} % [{100 * share.mean_low:.1f}, {100 * share.mean_high:.1f}] of the features "
        says += f"that may become landmarks lie on people or robots, over {len(results)} seeds"
        verdict = "holds" if share.mean_high < 0.01 else "does not hold" if share.mean_low > 0.01 else "undecided"
        paper = "dynamic objects are not detected (taken as: under 1 %)"
        found.append(Claim(world, paper, says, verdict, len(results)))
    return found


def _odometry_claims(outcomes: Outcomes) -> list[Claim]:
    """Where a plain run is one run, the seeds are those that leave something out."""
    found = []
    for cell, results in outcomes.items():
        name = "aligned_trimmed_rms_m" if "odometry_aligned_trimmed_rms_m" in results[0] else "aligned_rms_m"
        twice = bool(cell.left_out) and replace(cell, left_out=0.0) in outcomes
        twice |= bool(cell.particles) and outcomes.get(replace(cell, particles=None)) == results
        if cell.arm not in ("proposed", "ekf") or twice or cell.most_seeds or f"odometry_{name}" not in results[0]:
            continue
        ours, dead = column(results, f"particles_{name}"), column(results, f"odometry_{name}")
        better = int((ours < dead).sum())
        here = f"in {better} of {len(ours)} seeds (mean {ours.mean():.2f} against {dead.mean():.2f} m, {name})"
        verdict: Verdict = "holds" if better == len(ours) else "does not hold"
        where = f"{cell.world}, {cell.arm}" + (f", {cell.particles} particles" if cell.particles else "")
        where += f", {100 * cell.left_out:.0f} % left out" if cell.left_out else ""
        found.append(Claim(where, "SLAM is more accurate than odometry", here, verdict, len(ours)))
    return found
