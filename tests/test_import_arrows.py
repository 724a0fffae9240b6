"""The imports show the data flow; this holds them to it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OURS = ("drivers", "slam", "runtime")
KEEPS_KERNELS = ("slam/compiled.py", "slam/kernel_cache.py")
"""The only files of slam that know of the disk: where compiled kernels are kept, whoever imports slam."""
FORBIDDEN_IN_SLAM = (
    *("time", "threading", "random", "datetime", "socket", "os", "io", "pathlib"),
    *("serial", "can", "zenoh", "rerun"),
)


def imports_of(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""


def all_imports(package: str) -> list[tuple[Path, str]]:
    return [(path, name) for path in sorted((ROOT / package).rglob("*.py")) for name in imports_of(path)]


def allowed(package: str, name: str) -> bool:
    top = name.split(".")[0]
    if package == "drivers":
        return top not in ("slam", "runtime")
    if package == "slam":
        return top not in ("runtime", *FORBIDDEN_IN_SLAM) and (top != "drivers" or name == "drivers.measurements")
    return True


@pytest.mark.parametrize("package", OURS)
def test_imports_follow_the_data(package: str) -> None:
    found = all_imports(package)
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path, name in found
        if not allowed(package, name) and str(path.relative_to(ROOT)) not in KEEPS_KERNELS
    ]
    assert not wrong, "\n".join(wrong)


def test_only_the_simulated_rover_knows_of_the_simulation() -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path, name in all_imports("drivers")
        if name.startswith("drivers.simulated") and "simulated" not in path.parts
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("package", "name", "expected"),
    [
        ("drivers", "slam.pose", False),
        ("slam", "drivers.measurements", True),
        ("slam", "drivers.scip", False),
        ("slam", "time", False),
        ("runtime", "slam.pose", True),
    ],
)
def test_the_rule_tells_right_from_wrong(package: str, name: str, expected: bool) -> None:
    assert allowed(package, name) is expected


def test_the_packages_come_from_this_checkout() -> None:
    import drivers.measurements
    import runtime.tick
    import slam.pose

    for module in (drivers.measurements, runtime.tick, slam.pose):
        assert Path(str(module.__file__)).is_relative_to(ROOT), module.__file__


def test_files_stay_small() -> None:
    long = [
        f"{path.relative_to(ROOT)}: {lines} lines"
        for package in OURS
        for path in sorted((ROOT / package).rglob("*.py"))
        if (lines := len(path.read_text().splitlines())) > 300
    ]
    assert not long, "\n".join(long)
