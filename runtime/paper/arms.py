"""What is compared with what: each arm is a name and the settings of slam in which it differs from the defaults."""

from collections.abc import Mapping
from typing import Any

from runtime.overrides import TECHNIQUES

Settings = dict[str, Any]

NORMAL, PROPOSED = "normal", "proposed"
PROPOSALS = {PROPOSED: "unscented", "ekf": "ekf", "motion": "motion"}


def ablation_arms() -> list[str]:
    """Each technique off, and each alone."""
    return [f"without {name}" for name in TECHNIQUES] + [f"only {name}" for name in TECHNIQUES]


def arm_settings(arm: str) -> Settings:
    """Overrides of an arm. "normal" is the paper's normal estimation: all six techniques off.

    Raises ValueError on a name that is no arm.
    """
    kind, _, technique = arm.partition(" ")
    if arm in PROPOSALS:
        return {"proposal": PROPOSALS[arm]}
    if arm == NORMAL:
        return {"techniques": dict.fromkeys(TECHNIQUES, False)}
    if technique in TECHNIQUES and kind == "without":
        return {"techniques": {technique: False}}
    if technique in TECHNIQUES and kind == "only":
        return {"techniques": {name: name == technique for name in TECHNIQUES}}
    raise ValueError(f"{arm!r} is no arm: expected normal, {', '.join(PROPOSALS)}, without TECHNIQUE, only TECHNIQUE")


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Settings:
    """Nested tables, the second one wins."""
    result = dict(base)
    for key, value in changes.items():
        inner = result.get(key)
        both_tables = isinstance(inner, Mapping) and isinstance(value, Mapping)
        result[key] = merged(inner, value) if both_tables else value  # type: ignore[arg-type]
    return result
