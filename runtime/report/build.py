"""From a run to its report: RUN/report.html and RUN/report.json."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.measurements import Severity
from runtime.atomic_write import beside, write_together
from runtime.errors import StorageError
from runtime.record.folder import RunFolder
from runtime.report.facts import RunFacts
from runtime.report.figures import figures
from runtime.report.finding import RANKS, Finding
from runtime.report.gather import gather
from runtime.report.judge import judge
from runtime.report.page import page
from runtime.report.wheel_calibration import calibrated

HTML_NAME = "report.html"


@dataclass(frozen=True, slots=True, eq=False)
class ExaminedRun:
    """What a run holds, what is to be said about it, the most severe first, and its figures as report.json has them."""

    facts: RunFacts
    findings: list[Finding]
    figures: dict[str, Any]


def build_report(run: Path, out: Path | None = None) -> dict[str, Any]:
    """Write both files and give what report.json holds, with their paths under "files".

    out: an HTML file elsewhere, with the other beside it; None: into the run.
    Raises NotARunError, ConfigurationError, UsageError (an import without a replay), StorageError.
    """
    html = RunFolder.open(run).path / HTML_NAME if out is None else out
    data = beside(html, ".json")
    examined = examine(run)
    text = json.dumps(examined.figures, indent=1, default=float) + "\n"
    try:
        write_together({html: page(examined.facts, examined.findings, examined.figures), data: text})
    except OSError as error:
        raise StorageError(f"{html} cannot be written ({error.strerror}); give another name with --out") from error
    return {**examined.figures, "files": {"html": str(html), "json": str(data)}}


def examine(run: Path) -> ExaminedRun:
    """Gather, calibrate, judge. Raises as build_report does."""
    facts = calibrated(gather(run))
    findings = judge(facts)
    return ExaminedRun(facts, findings, figures(facts, findings))


def is_as_grave(report: dict[str, Any], severity: str) -> bool:
    """Whether a finding has this severity or a higher one."""
    least = RANKS[Severity(severity)]
    return any(RANKS[Severity(finding["severity"])] >= least for finding in report["findings"])


def report_lines(report: dict[str, Any]) -> list[str]:
    """The report for a person at a terminal."""
    lines = [f"verdict   {report['verdict']}" + (f": {report['because']}" if report["because"] else "")]
    for finding in report["findings"]:
        lines.append(f"{finding['severity']!s:9s} {finding['title']}")
        if finding["severity"] != "info":
            lines += [f"          cause:  {finding['cause']}", f"          remedy: {finding['remedy']}"]
    return [*lines, f"report    {report['files']['html']}"]
