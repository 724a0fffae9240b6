"""The imports show the data flow, and the folders are a plan; this holds the code to both."""

import ast
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

import pytest

from runtime.source_tree import ROOT

OURS = ("drivers", "slam", "runtime")
FILES_IN_A_FOLDER = 12
LINES_IN_A_FILE = 300
FORBIDDEN_IN_SLAM = (
    *("time", "threading", "random", "datetime", "socket", "os", "io", "pathlib"),
    *("serial", "can", "zenoh", "rerun"),
)
TOP_LEVEL = {".ci", "config", "docs", "drivers", "runtime", "slam", "systemd", "tests"}
KEEPS_KERNELS = ("slam/compiled.py", "slam/kernel_cache.py")
"""The only files of slam that know of the disk: where compiled kernels are kept, whoever imports slam."""
NOT_IN_THE_LOOP = ("rerun", "matplotlib", "runtime.review", "runtime.report", "runtime.studies")

Arrows = Mapping[PurePosixPath, set[PurePosixPath]]


def imports_of(path: Path) -> Iterator[str]:
    """Every module that a file names, wherever it does: inside a function too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def all_imports(package: str) -> list[tuple[Path, str]]:
    return [(path, name) for path in sources(package) for name in imports_of(path)]


def allowed(package: str, name: str) -> bool:
    top = name.split(".")[0]
    if package == "drivers":
        return top not in ("slam", "runtime")
    if package == "slam":
        measured = name.startswith("drivers.measurements.")
        return top not in ("runtime", *FORBIDDEN_IN_SLAM) and (top != "drivers" or measured)
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


def test_the_product_stands_on_no_study() -> None:
    """Only the command line starts one."""
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for package in OURS
        for path, name in all_imports(package)
        if name.startswith("runtime.studies.")
        and not path.is_relative_to(ROOT / "runtime" / "studies")
        and not path.is_relative_to(ROOT / "runtime" / "cli")
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("package", "name", "expected"),
    [
        ("drivers", "slam.pose.Pose2", False),
        ("slam", "drivers.measurements.Scan", True),
        ("slam", "drivers.scip.codec.decode", False),
        ("slam", "time", False),
        ("runtime", "slam.pose.Pose2", True),
    ],
)
def test_the_rule_tells_right_from_wrong(package: str, name: str, expected: bool) -> None:
    assert allowed(package, name) is expected


def file_of(name: str) -> PurePosixPath | None:
    """The file of ours that `from a.b import c` reads, as a path relative to the tree."""
    for words in (name.split("."), name.split(".")[:-1]):
        for path in (PurePosixPath(*words).with_suffix(".py"), PurePosixPath(*words, "__init__.py")) if words else ():
            if (ROOT / path).is_file():
                return path
    return None


def file_arrows() -> Arrows:
    arrows: defaultdict[PurePosixPath, set[PurePosixPath]] = defaultdict(set)
    for package in OURS:
        for path, name in all_imports(package):
            here, there = PurePosixPath(path.relative_to(ROOT)), file_of(name)
            if there is not None and there != here and there.name != "__init__.py":
                arrows[here].add(there)
    return arrows


def room_arrows(arrows: Arrows, folder: PurePosixPath) -> Arrows:
    """What the rooms of one folder (its files, and its folders with all that is in them) import of each other."""
    depth, rooms = len(folder.parts), defaultdict(set)
    for here, there in ((a, b) for a, targets in arrows.items() for b in targets):
        if here.is_relative_to(folder) and there.is_relative_to(folder) and here.parts[depth] != there.parts[depth]:
            rooms[folder / here.parts[depth]].add(folder / there.parts[depth])
    return rooms


def circle(arrows: Arrows) -> list[PurePosixPath]:
    """A way that leads back to where it began; empty where there is none."""
    done: set[PurePosixPath] = set()

    def walk(here: PurePosixPath, way: list[PurePosixPath]) -> list[PurePosixPath]:
        if here in way:
            return [*way[way.index(here) :], here]
        if here in done:
            return []
        for there in sorted(arrows.get(here, ())):
            if found := walk(there, [*way, here]):
                return found
        done.add(here)
        return []

    return next((found for start in sorted(arrows) if (found := walk(start, []))), [])


def test_no_file_and_no_room_stands_on_itself() -> None:
    arrows = file_arrows()
    folders = {PurePosixPath("."), *(parent for path in arrows for parent in path.parents)}
    found = [circle(arrows), *(circle(room_arrows(arrows, folder)) for folder in sorted(folders))]
    assert not any(found), "\n".join(" -> ".join(map(str, each)) for each in found if each)


def test_a_circle_is_found() -> None:
    a, b, c = (PurePosixPath("slam", name) for name in ("a.py", "room/b.py", "room/c.py"))
    assert circle({a: {b}, b: {c}, c: {a}}) == [a, b, c, a]
    assert circle({a: {b}, b: {c}}) == []
    assert circle(room_arrows({a: {b}, c: {a}}, PurePosixPath("slam"))), "through the folder `room`"


def test_no_folder_is_a_heap() -> None:
    folders = {path.parent for package in OURS for path in sources(package)}
    count = {folder: sum(path.name != "__init__.py" for path in folder.glob("*.py")) for folder in folders}
    heaps = [
        f"{folder.relative_to(ROOT)}: {files} files" for folder, files in count.items() if files > FILES_IN_A_FOLDER
    ]
    assert not heaps, "\n".join(heaps)


def test_every_folder_has_a_door_that_says_what_it_is_for() -> None:
    """Some sentences and nothing else; only `slam` and `runtime` hand out their public names."""
    wrong = []
    for folder in sorted({path.parent for package in OURS for path in sources(package)}):
        tree = ast.parse((folder / "__init__.py").read_text())
        hands_out = folder in (ROOT / "slam", ROOT / "runtime")
        if not ast.get_docstring(tree) or (len(tree.body) > 1 and not hands_out):
            wrong.append(str(folder.relative_to(ROOT)))
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("package", OURS)
def test_tests_lie_in_the_same_folders_as_what_they_test(package: str) -> None:
    folders = {path.parent.relative_to(ROOT) for path in sources(package)}
    tested = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests" / package).rglob("test_*.py")}
    assert tested <= folders, sorted(map(str, tested - folders))


def test_the_loop_reaches_neither_pictures_nor_studies() -> None:
    program = (
        "import sys, runtime.live.run, runtime.live.parts\n"
        f"print(*[name for name in sys.modules if name.startswith({NOT_IN_THE_LOOP!r})])"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_packages_come_from_this_checkout() -> None:
    import drivers.measurements
    import runtime.tick
    import slam.pose

    for module in (drivers.measurements, runtime.tick, slam.pose):
        assert Path(str(module.__file__)).is_relative_to(ROOT), module.__file__


def test_the_folders_at_the_top_are_those_of_the_plan() -> None:
    """The output of a study, written where it was run, was once committed with its jobs."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git: what belongs to it is not known")
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert {path.partition("/")[0] for path in tracked if "/" in path} == TOP_LEVEL


def test_files_stay_small() -> None:
    long = [
        f"{path.relative_to(ROOT)}: {lines} lines"
        for package in OURS
        for path in sources(package)
        if (lines := len(path.read_text().splitlines())) > LINES_IN_A_FILE
    ]
    assert not long, "\n".join(long)


@pytest.mark.parametrize("package", ["slam", "runtime"])
def test_public_names_are_there_and_cost_nothing_until_they_are_asked_for(package: str) -> None:
    program = (
        f"import sys, {package}\n"
        "assert 'numpy' not in sys.modules\n"
        f"print(*[getattr({package}, name).__name__ for name in {package}.__all__])\n"
        f"assert not hasattr({package}, 'anything_else')"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == sorted(done.stdout.split())
    assert done.stdout.split()
