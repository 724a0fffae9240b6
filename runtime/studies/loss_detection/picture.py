"""The curve: losses detected against false alarms, for either bound."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.optional_packages import needs

TITLES = {"lost_score": "kidnapped, by lost_score", "lost_blind_s": "blinded, by lost_blind_s"}


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """What one bound gives: share of the mishaps detected within 3 s, and false alarms an hour."""

    bound: str
    value: float
    detected_share: float
    false_per_hour: float


def draw(points: Sequence[CurvePoint], path: Path) -> None:
    """One panel for each bound. Raises UsageError where the extra `review` is missing."""
    with needs("matplotlib", "the curve"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    for panel, (bound, title) in zip(figure.subplots(1, 2), TITLES.items(), strict=True):
        row = [point for point in points if point.bound == bound]
        panel.plot([p.false_per_hour for p in row], [100.0 * p.detected_share for p in row], "o-", color="tab:blue")
        for point in row:
            panel.annotate(
                f"{point.value:g}",
                (point.false_per_hour, 100.0 * point.detected_share),
                textcoords="offset points",
                xytext=(5, -10),
                fontsize=7,
            )
        panel.set_xscale("symlog", linthresh=0.1)
        panel.axhline(95.0, color="grey", linewidth=0.8, linestyle="--")
        panel.axvline(1.0, color="grey", linewidth=0.8, linestyle="--")
        panel.set_xlabel("false alarms per hour")
        panel.set_ylabel("detected within 3 s, %")
        panel.set_ylim(-3.0, 105.0)
        panel.set_title(title, fontsize=10)
    figure.savefig(path, dpi=120)
