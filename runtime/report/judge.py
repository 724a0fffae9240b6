"""All findings of a run, and the verdict that follows from them."""

from collections.abc import Sequence

from drivers.measurements import Severity
from runtime.report.causality import ordered
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, worst
from runtime.report.findings.geometry import geometry_findings
from runtime.report.findings.laser import laser_findings
from runtime.report.findings.map import map_findings
from runtime.report.findings.pose import pose_findings
from runtime.report.findings.running import running_findings
from runtime.report.findings.searching import searching_findings
from runtime.report.findings.smoothed import smoothed_findings
from runtime.report.findings.wheels import wheel_findings

VERDICTS = {
    Severity.INFO: "healthy",
    Severity.WARN: "usable, but worth a look",
    Severity.ERROR: "not reliable as it is",
}


def judge(facts: RunFacts) -> list[Finding]:
    """Causes before what follows from them, the gravest first."""
    return ordered(
        [
            *laser_findings(facts),
            *wheel_findings(facts),
            *geometry_findings(facts),
            *running_findings(facts),
            *searching_findings(facts),
            *pose_findings(facts),
            *map_findings(facts),
            *smoothed_findings(facts),
        ]
    )


def verdict(findings: Sequence[Finding]) -> str:
    """In a few words."""
    return VERDICTS[worst(findings)]


def because(findings: Sequence[Finding]) -> str:
    """The finding that made the verdict; "" for a healthy run."""
    grave = worst(findings)
    if grave is Severity.INFO:
        return ""
    first = next(finding for finding in findings if finding.severity is grave)
    return f"{first.title}; {first.cause}" if first.follows else first.title
