"""How many inputs a property test draws, in proportion to the hypothesis profile in force (tests/conftest.py)."""

from hypothesis import settings

USUAL = 100  # hypothesis's own number, and that of `make test`


def examples(usual: int) -> settings:
    """Settings that draw `usual` inputs in `make test` and as many times more in `make fuzz` as any other test."""
    in_force = settings.get_profile(settings.get_current_profile_name())
    return settings(max_examples=max(1, usual * in_force.max_examples // USUAL))
