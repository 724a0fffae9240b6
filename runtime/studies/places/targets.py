"""What this project asks of itself in any place: each figure with the most that it must be and should be."""

from collections.abc import Iterator

import numpy as np

from runtime.studies.files import Row
from runtime.studies.paper.spread import interval, spread
from runtime.studies.places.drop_outs import CORRIDOR, PARK, SHARES
from runtime.studies.places.outcomes import AT_REST, BUILDINGS, DEFAULTS, OWN, SIMULATED, Outcome, Outcomes, dropped

Limits = tuple[float, float]  # the most that it must be, and should be
Asked = tuple[str, str, str, str, Limits]  # place, way, figure, statistic, limits

WHOLE, MEAN, MEDIAN, WORST = "everything seen", "mean", "median", "worst"
OF_ONE_PLACE: tuple[Asked, ...] = (
    ("fr079_a", OWN, "published_relation_m", WHOLE, (0.20, 0.06)),
    ("fr079_a", OWN, "published_relation_deg", WHOLE, (3.0, 1.8)),
    ("fr079_a", OWN, "published_relation_m", MEAN, (0.20, 0.06)),
    ("fr079_a", OWN, "published_relation_deg", MEAN, (3.0, 1.8)),
    ("intel_lab", OWN, "published_relation_m", WHOLE, (0.13, 0.09)),
    ("intel_lab", OWN, "published_relation_m", MEAN, (0.20, 0.10)),
    ("victoria_park", OWN, "published_trimmed_rms_m", MEDIAN, (1.45, 1.3)),
    ("victoria_park", OWN, "published_trimmed_rms_m", WORST, (2.1, 1.6)),
    *((name, OWN, "cells_over_odometry", WHOLE, (0.8, 0.7)) for name in ("minesparis_exp1", "minesparis_exp2")),
    *((name, OWN, "lost", WORST, (0.0, 0.0)) for name in ("create3_hall", "furo_corridor")),
    *((name, SIMULATED, "published_aligned_rms_m", MEAN, (0.25, 0.05)) for name in BUILDINGS),
    *((name, AT_REST, "moving_share", WHOLE, (0.05, 0.01)) for name in ("people_walk1", "people_stationary_demo")),
)
OF_EVERY_PLACE: tuple[tuple[str, Limits], ...] = (
    ("over_odometry", (1.0, 1.0)),
    ("false_lost", (0.02, 0.002)),
    ("false_tracking", (0.02, 0.0)),
)
TRIMMED_M, TRIMMED_SHARE = (0.5, 0.2), (0.01, 0.003)  # of the way, whichever is more
OVER_ODOMETRY_AIM = 0.3  # as a median over the places
DEFAULTS_OVER_OWN: Limits = (1.3, 1.05)
DROPPED_LIMITS: dict[str, Limits] = {"landmarks": (1.5, 1.1), "step_ms": (2.0, 1.3)}


def asked_rows(outcomes: Outcomes) -> list[Row]:
    """Each figure that has a limit, its value with a 95 % interval where it is repeated, and whether it is reached."""
    return [*_of_all(outcomes), *_of_one(outcomes), *_dropped(outcomes)]


def primary_error(outcome: Outcome) -> float | None:
    """Mean error of the relations where there are any, else RMS, in m; None without truth."""
    result = outcome.results[0]
    error: float | None = result.get("published_relation_m", result.get("published_rms_m"))
    return error


def _of_one(outcomes: Outcomes) -> Iterator[Row]:
    for place, way, figure, statistic, limits in OF_ONE_PLACE:
        outcome = outcomes.get((place, way))
        if outcome is None or not len(outcome.values(figure)):
            continue
        repeated = outcome.repeated(figure)
        if statistic == WHOLE and outcome.whole is not None:
            yield _row(place, way, figure, statistic, outcome.whole[figure], limits)
        elif statistic == WORST:
            yield _row(place, way, figure, statistic, float(outcome.values(figure).max()), limits)
        elif len(repeated):
            found = spread(repeated).row()
            bounds = (found[f"{statistic}_low"], found[f"{statistic}_high"])
            yield _row(place, way, figure, f"{statistic} of {len(repeated)}", found[statistic], limits, bounds)


def _of_all(outcomes: Outcomes) -> Iterator[Row]:
    """The worst of all places and repeats: what holds everywhere holds there."""
    for way in (OWN, DEFAULTS):
        driven = {place: outcome for (place, of), outcome in outcomes.items() if of == way}
        for figure, limits in OF_EVERY_PLACE:
            values = {place: found for place, outcome in driven.items() if len(found := outcome.values(figure))}
            if not values:
                continue
            worst = max(values, key=lambda place: float(values[place].max()))
            yield _row(f"every place, worst {worst}", way, figure, WORST, float(values[worst].max()), limits)
            if figure == "over_odometry":
                middle = float(np.median([found[0] for found in values.values()]))
                yield _row("every place", way, figure, "median of the places", middle, (1.0, OVER_ODOMETRY_AIM))
        yield from _trimmed(driven, way)
    ratios = {
        place: mine / own
        for place, way in outcomes
        if way == DEFAULTS
        and (mine := primary_error(outcomes[place, DEFAULTS])) is not None
        and (place, OWN) in outcomes
        and (own := primary_error(outcomes[place, OWN]))
    }
    if ratios:
        worst = max(ratios, key=lambda place: ratios[place])
        name = f"every place, worst {worst}"
        yield _row(name, DEFAULTS, "error over that with the own file", WORST, ratios[worst], DEFAULTS_OVER_OWN)


def _trimmed(driven: dict[str, Outcome], way: str) -> Iterator[Row]:
    """Trimmed RMS over its own limit, which grows with the way: at most 1."""
    for word, least_m, share in zip(("must", "aim"), TRIMMED_M, TRIMMED_SHARE, strict=True):
        over = {
            place: max(r["published_trimmed_rms_m"] / max(least_m, share * r["way_m"]) for r in outcome.results)
            for place, outcome in driven.items()
            if len(outcome.values("published_trimmed_rms_m"))
        }
        if over:
            worst = max(over, key=lambda place: over[place])
            limit = f"trimmed RMS over {least_m:g} m or {100 * share:g} % of the way ({word})"
            limits = (1.0, 1.0) if word == "must" else (np.inf, 1.0)
            yield _row(f"every place, worst {worst}", way, limit, WORST, over[worst], limits)


def _dropped(outcomes: Outcomes) -> Iterator[Row]:
    """Ratios of means, paired by seed."""
    for where in (PARK, CORRIDOR):
        base = outcomes.get((where, dropped(0.0)))
        for share in SHARES:
            outcome = outcomes.get((where, dropped(share)))
            if base is None or outcome is None:
                continue
            for figure, limits in DROPPED_LIMITS.items():
                both = np.column_stack((outcome.repeated(figure), base.repeated(figure)))
                low, high = interval(both, lambda draws: draws[..., 0].mean(axis=1) / draws[..., 1].mean(axis=1))
                ratio = float(both[:, 0].mean() / both[:, 1].mean())
                what, many = f"{figure} over those without", f"ratio of means of {len(both)}"
                yield _row(where, dropped(share), what, many, ratio, limits, (low, high))


def _row(
    place: str,
    way: str,
    figure: str,
    statistic: str,
    value: float,
    limits: Limits,
    bounds: tuple[float | None, float | None] = (None, None),
) -> Row:
    must, aim = limits
    return {
        "place": place,
        "way": way,
        "figure": figure,
        "statistic": statistic,
        "value": value,
        "low": bounds[0],
        "high": bounds[1],
        "must": must if np.isfinite(must) else None,
        "aim": aim,
        "reached": "aim" if value <= aim else "must" if value <= must and np.isfinite(must) else "not reached",
    }
