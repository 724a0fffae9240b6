"""What a check of `infant check` found; light, because a check of the file alone loads no driver."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class CheckResult(StrEnum):
    """Result of one check; the worst one is the result of all."""

    PASS = "PASS"  # noqa: S105
    WARN = "WARN"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Check:
    """One check: what was seen, and what to do about it ("" when there is nothing to do)."""

    name: str
    verdict: CheckResult
    reason: str
    remedy: str = ""


def worst_result(checks: list[Check]) -> CheckResult:
    """FAIL outranks WARN outranks PASS."""
    return max((check.verdict for check in checks), key=list(CheckResult).index, default=CheckResult.PASS)


def preflight_result(checks: list[Check]) -> dict[str, Any]:
    """As --json prints it."""
    return {"result": worst_result(checks), "checks": [asdict(check) for check in checks]}
