"""What is compared with what: each arm is a name and the settings of slam in which it differs from the defaults."""

from collections.abc import Mapping
from typing import Any

from runtime.settings.overrides import TECHNIQUES

Settings = dict[str, Any]

NORMAL, PROPOSED = "normal", "proposed"
RANGE = "range"
RANGE_GATED = f"only {RANGE}"  # normal estimation without the likelihoods that a gate saves
PROPOSALS = {PROPOSED: "unscented", "ekf": "ekf", "motion": "motion"}


def ablation_arms() -> list[str]:
    """Each technique off, and each alone, there with the range gate: that changes nothing but time.

    Without the gate one drive among people takes minutes, and ends at the same figures.
    """
    alone = [name if name == RANGE else f"{name} and {RANGE}" for name in TECHNIQUES]
    return [f"without {name}" for name in TECHNIQUES] + [f"only {names}" for names in alone]


def arm_settings(arm: str) -> Settings:
    """Overrides of an arm. "normal" is the paper's normal estimation: all six techniques off.

    Raises ValueError on a name that is no arm.
    """
    kind, _, rest = arm.partition(" ")
    named = rest.split(" and ")
    if arm in PROPOSALS:
        return {"proposal": PROPOSALS[arm]}
    if arm == NORMAL:
        return {"techniques": dict.fromkeys(TECHNIQUES, False)}
    if set(named) <= set(TECHNIQUES) and kind == "without":
        return {"techniques": dict.fromkeys(named, False)}
    if set(named) <= set(TECHNIQUES) and kind == "only":
        return {"techniques": {name: name in named for name in TECHNIQUES}}
    expected = f"normal, {', '.join(PROPOSALS)}, without TECHNIQUE [and TECHNIQUE]..., or only the like"
    raise ValueError(f"{arm!r} is not an arm: expected {expected}")


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Settings:
    """Nested tables, the second one wins."""
    result = dict(base)
    for key, value in changes.items():
        inner = result.get(key)
        both_tables = isinstance(inner, Mapping) and isinstance(value, Mapping)
        result[key] = merged(inner, value) if both_tables else value  # type: ignore[arg-type]
    return result
