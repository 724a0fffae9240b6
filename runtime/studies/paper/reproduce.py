"""From a study to its files and its plain words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from runtime.errors import StorageError
from runtime.optional_packages import needs
from runtime.studies.files import write_json, write_rows, write_text
from runtime.studies.paper import tables
from runtime.studies.paper.claims import OURS, claims
from runtime.studies.paper.page import report_lines
from runtime.studies.paper.published_pose import published_lines, published_rows, unscented_rows
from runtime.studies.paper.study import OUTDOOR, PRINTED, Cell, Study, comparison_rows, run_study, spread_rows


def reproduce(
    study: Study, folder: Path, scheduler: str | None, progress: Callable[[int, int], None]
) -> dict[str, Any]:
    """Run what is missing, write pictures and tables into folder, and return what --json prints.

    Raises UsageError without matplotlib or a scheduler, StorageError where folder cannot be written.
    """
    with needs("matplotlib", "infant paper"):  # said before the hours of computing, not after
        from runtime.studies.paper import pictures as figures
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{folder}: cannot be made ({error.strerror}); choose another --out") from error
    outcomes = run_study(study, folder, scheduler, progress)
    spreads, comparisons = spread_rows(outcomes), comparison_rows(outcomes)
    written: list[Path] = []
    parts = set(study.parts)
    if "fig1" in parts:
        written += figures.fig1(outcomes, folder)
    if "fig2" in parts:
        pictures, rows = figures.fig2(outcomes, folder)
        written += pictures
        write_rows(folder / "fig2.csv", rows)
    if "table1" in parts:
        rows = tables.table1_rows(spreads)
        write_rows(folder / "table1.csv", rows)
        written += figures.table1(rows, folder)
    if "ablation" in parts:
        write_rows(folder / "ablation.csv", [row for row in comparisons if row["world"] == "V2"])
        written += figures.ablation([row for row in comparisons if row["world"] == "V2"], folder)
    if "fig5" in parts:
        rows = [row for world in (OUTDOOR, PRINTED) for row in tables.scan_rows(outcomes, Cell(world, "proposed"))]
        write_rows(folder / "fig5.csv", rows)
        written += figures.fig5(outcomes, folder)
    if "fig6" in parts:
        written += figures.fig6(outcomes, folder)
    write_rows(folder / "paths.csv", tables.path_rows(outcomes))
    write_rows(folder / "maps.csv", tables.map_rows(outcomes))
    write_rows(folder / "figures.csv", spreads)
    write_rows(folder / "comparisons.csv", comparisons)
    found, unscented = claims(outcomes, comparisons), unscented_rows(comparisons)
    write_rows(folder / "unscented.csv", unscented)
    published = published_rows(spreads, comparisons) if "published" in parts else []
    if published:
        write_rows(folder / "published.csv", published)
    result = {
        "out": str(folder),
        "parts": list(study.parts),
        "seeds": study.seeds,
        "particles": study.particles,
        "claims": [claim.row() for claim in found],
        "sentences": [claim.sentence for claim in found],
        "published": published,
        "unscented": unscented,
        "figures": spreads,
        "comparisons": comparisons,
        "not_given_in_the_paper": list(OURS),
        "pictures": [str(path) for path in written],
    }
    write_json(folder / "paper.json", result)
    write_text(folder / "results.md", report_lines(result))
    return result


def study_lines(result: dict[str, Any]) -> list[str]:
    """For people."""
    return [
        *result["sentences"],
        "",
        *published_lines(result["published"], result["unscented"]),
        "",
        f"{result['seeds']} seeds, {result['particles']} particles. The outdoor drive is simulated: the original "
        "recording is not public.",
        "Ours, because the paper does not give them: " + "; ".join(result["not_given_in_the_paper"]) + ".",
        f"Pictures, CSV, results.md and paper.json: {result['out']}",
    ]
