"""No test fails by chance: whatever a test draws is the same each time it runs."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

TESTS = Path(__file__).parent
FILES = sorted(TESTS.rglob("*.py"))
MAKES_A_GENERATOR = {"default_rng", "Random", "SeedSequence", "RandomState"}
DRAWS_FROM_THE_SYSTEM = {"urandom", "uuid1", "uuid4", "token_bytes", "token_hex", "SystemRandom"}
SETS_THE_PROFILES = {TESTS / "conftest.py", TESTS / "support" / "examples.py", Path(__file__)}


def calls(path: Path) -> Iterator[tuple[int, str, ast.Call]]:
    """Line, last name and node of every call in a file."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            yield node.lineno, node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id, node


def test_every_generator_of_random_numbers_is_seeded() -> None:
    unseeded = [
        f"{path.relative_to(TESTS)}:{line}"
        for path in FILES
        for line, name, call in calls(path)
        if name in DRAWS_FROM_THE_SYSTEM or (name in MAKES_A_GENERATOR and not call.args and not call.keywords)
    ]
    assert not unseeded


def test_the_names_of_tests_are_the_same_at_another_time_and_in_another_process(request: pytest.FixtureRequest) -> None:
    """Processes that share the tests compare the names; one that holds a time or a set's order ends the whole run."""
    listed = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "tests.support.another_day", "--collect-only", "-q", "-m", ""],
        cwd=TESTS.parent,
        env={**os.environ, "PYTHONHASHSEED": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert not {item.nodeid for item in request.session.items} - set(listed.splitlines())


def test_no_property_test_has_settings_beside_the_profile_but_its_number_of_examples() -> None:
    own = [
        str(path.relative_to(TESTS))
        for path in FILES
        if path not in SETS_THE_PROFILES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module == "hypothesis"
        if {"settings", "seed", "HealthCheck"} & {name.name for name in node.names}
    ]
    assert not own


def test_the_profile_in_force_is_the_same_each_time_unless_it_is_asked_for_new_inputs() -> None:
    assert settings.get_profile("default").derandomize
    assert settings.get_profile("default").deadline is None
    assert settings.get_current_profile_name() in ("default", "fuzz")
