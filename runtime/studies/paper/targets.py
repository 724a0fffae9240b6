"""The figures of the published pose that this project sets itself, each with the most that it must be and should be."""

from dataclasses import dataclass, replace

from runtime.studies.paper.drives.arms import NORMAL, RANGE_GATED
from runtime.studies.paper.drives.recorded_drive import CODED, INDOOR, VICTORIA
from runtime.studies.paper.study import LEFT_OUT, OUTDOOR, VICTORIA_PARTICLES, WITHHELD

MEDIAN, MEAN, WORST, RATIO = "median", "mean", "worst", "ratio of means"
START, FITTED = "start pose", "rigid fit"
Limits = tuple[float, float]  # the most that it must be, and should be
ESTIMATES = {"published": "published pose", "particles": "particles' own mean", "odometry": "odometry alone"}


@dataclass(frozen=True, slots=True)
class Target:
    """One figure: what and in which frame, where it comes from, its limits. against: the arm it is divided by."""

    what: str
    frame: str
    world: str
    quantity: str
    statistic: str
    limits: Limits | None = None
    particles: int | str = ""
    left_out: float = 0.0
    against: str = ""


def targets() -> list[Target]:
    """Every figure, in the order of the table."""
    return [*_victoria(), *_feature_worlds(), *_against_normal(), *_coded(), *_indoor(), *_lonely()]


def _victoria() -> list[Target]:
    aims = {(10, MEDIAN): (2.2, 1.4), (10, WORST): (4.0, 1.8), (100, MEDIAN): (2.0, 1.3), (100, WORST): (3.5, 1.6)}
    return [
        Target(
            f"{ESTIMATES[whose]}, 95 %-trimmed RMS at the laser point, m",
            FITTED,
            VICTORIA,
            f"{whose}_aligned_trimmed_rms_m",
            statistic,
            aims[particles, statistic] if whose == "published" else None,
            particles,
            left_out,
        )
        for left_out in (0.0, LEFT_OUT)
        for particles in VICTORIA_PARTICLES
        for whose in ("published", "particles")
        for statistic in (MEDIAN, WORST)
    ]


def _feature_worlds() -> list[Target]:
    figures = []
    aims = {
        ("P", "largest_m"): (1.0, 0.6),
        ("P", "aligned_rms_m"): (0.20, 0.10),
        ("P", "landmarks"): (1.2, 1.05),
        ("V2", "largest_m"): (1.1, 0.5),
        ("V2", "aligned_rms_m"): (0.25, 0.10),
    }
    for world in ("P", "V2"):
        for particles in (30, 100):
            for whose in ("published", "particles"):
                for name, frame in (
                    ("largest_m", START),
                    ("aligned_largest_m", FITTED),
                    ("rms_m", START),
                    ("aligned_rms_m", FITTED),
                ):
                    what = f"{ESTIMATES[whose]}, {'largest error' if 'largest' in name else 'RMS'}, m"
                    limits = aims.get((world, name)) if whose == "published" else None
                    figures.append(Target(what, frame, world, f"{whose}_{name}", MEAN, limits, particles))
        for whose, name in (("published", "landmarks_published_ratio"), ("particles", "landmarks_ratio")):
            what = f"{ESTIMATES[whose]}, landmarks over true ones ever in view"
            figures.append(Target(what, "-", world, name, MEAN, aims.get((world, "landmarks")), 30))
        figures.append(_consistency(world, particles=30))
    return figures


def _against_normal() -> list[Target]:
    figures = []
    for world in ("V2", "P"):
        for arm, particles in ((NORMAL, ""), (RANGE_GATED, 30)):
            for whose, limits in (("published", (0.35, 0.2)), ("particles", (0.45, 0.3))):
                base = "normal estimation" if arm == NORMAL else "normal estimation with a range gate"
                what = f"{ESTIMATES[whose]}, largest error over that of {base}"
                applied = limits if world == "V2" and arm == RANGE_GATED else None
                figures.append(Target(what, START, world, f"{whose}_largest_m", RATIO, applied, particles, against=arm))
        for what, name, applied in (
            ("likelihood evaluations", "likelihoods", (0.1, 0.05)),
            ("CPU time of the filter", "filter_cpu_s", None),
        ):
            says = f"{what} over those of normal estimation"
            figures.append(Target(says, "-", world, name, RATIO, applied, against=NORMAL))
    return figures


def _coded() -> list[Target]:
    figures = []
    for withheld, limits in (("", (0.25, 0.08)), (f", {WITHHELD}", (0.50, 0.12))):
        for world in [f"{name}{withheld}" for name in CODED]:
            for left_out, statistics in ((0.0, (MEAN,)), (LEFT_OUT, (MEAN, MEDIAN, WORST))):
                for whose in ("published", "particles"):
                    applied = limits if whose == "published" else None
                    figures += [
                        Target(
                            f"{ESTIMATES[whose]}, RMS, m",
                            FITTED,
                            world,
                            f"{whose}_aligned_rms_m",
                            statistic,
                            applied if statistic == MEAN else None,
                            "",
                            left_out,
                        )
                        for statistic in statistics
                    ]
                figures += [
                    replace(_consistency(world, left_out=left_out), statistic=statistic) for statistic in statistics[:2]
                ]
    return figures


def _indoor() -> list[Target]:
    return [
        Target(
            f"{ESTIMATES[whose]}, relations, {unit}",
            "relative",
            INDOOR,
            f"{whose}_{name}",
            MEAN,
            limits if whose == "published" else None,
            left_out=left_out,
        )
        for left_out in (0.0, LEFT_OUT)
        for whose in ("published", "particles", "odometry")
        for name, unit, limits in (
            ("relation_translation_m", "m", (1.0, 0.1)),
            ("relation_rotation_deg", "deg", (10.0, 3.0)),
        )
    ]


def _lonely() -> list[Target]:
    figures = [
        Target(f"{ESTIMATES[whose]}, largest error, m", START, "LONELY", f"{whose}_largest_m", statistic)
        for whose in ("published", "particles", "odometry")
        for statistic in (MEAN, WORST)
    ]
    figures.append(Target("median NEES of the published pose", START, "LONELY", "nees_median", MEAN))
    worlds: tuple[tuple[str, int | str], ...]
    worlds = (("LONELY", ""), ("P", 100), ("V2", 100), (VICTORIA, 100), (OUTDOOR, ""))
    return figures + [
        Target("numbers that are not finite", "-", world, "not_finite", WORST, (0.0, 0.0), particles)
        for world, particles in worlds
    ]


def _consistency(world: str, particles: int | str = "", left_out: float = 0.0) -> Target:
    limits = (6.0, 3.0)  # the upper ends; the lower ones are 1 and 2
    return Target("median NEES of the published pose", START, world, "nees_median", MEAN, limits, particles, left_out)
