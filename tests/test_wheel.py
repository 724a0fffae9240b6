"""What `pip install` puts on a machine."""

import io
import runpy
import sys
from importlib import import_module
from pathlib import Path

import pytest

from infant import foreign_packages
from runtime.source_tree import CONFIG, ROOT, SYSTEMD


def wheel_files(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names in the wheel, as setuptools would put them there, without building it."""
    monkeypatch.chdir(ROOT)
    distribution = import_module("setuptools").Distribution({"script_name": "setup.py"})
    distribution.parse_config_files(["pyproject.toml"])
    build = distribution.get_command_obj("build_py")
    build.set_undefined_options("build", ("build_lib", "build_lib"))
    build.build_lib = "out"
    build.ensure_finalized()
    return {name.removeprefix("out/") for name in build.get_outputs(include_bytecode=False)}


def test_the_wheel_holds_configurations_units_and_message_definitions(monkeypatch: pytest.MonkeyPatch) -> None:
    names = wheel_files(monkeypatch)
    wanted = {f"runtime/shipped/config/{path.relative_to(CONFIG)}" for path in CONFIG.rglob("*") if path.is_file()}
    wanted |= {f"runtime/shipped/systemd/{path.name}" for path in SYSTEMD.iterdir()}
    layouts = ROOT / "drivers" / "wheels" / "layouts"
    wanted |= {f"drivers/wheels/layouts/{path.name}" for path in layouts.iterdir() if path.suffix in (".dbc", ".eds")}
    wanted |= {str(path.relative_to(ROOT)) for path in (ROOT / "runtime" / "report" / "templates").iterdir()}
    wanted |= {f"{package}/py.typed" for package in ("drivers", "runtime", "slam")} | {"infant.py"}
    assert wanted - names == set()
    assert {name.split("/")[0] for name in names} == {"drivers", "runtime", "slam", "infant.py"}


def test_a_package_of_the_same_name_from_elsewhere_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert foreign_packages(ROOT) == []
    home = tmp_path / "site"
    for name in ("drivers", "runtime", "slam"):
        (home / name).mkdir(parents=True)
    sentences = foreign_packages(home)
    assert [sentence.split()[1] for sentence in sentences] == ["drivers", "runtime", "slam"]
    assert str(ROOT / "slam") in sentences[2]
    assert str(home / "slam") in sentences[2]
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "infant.py"), run_name="__main__")
    assert ended.value.code == 70
    assert "package slam would be imported from nowhere" in said.getvalue()


def test_ctrl_c_while_packages_are_loaded_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("runtime.cli.__main__.main", interrupted)
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "infant.py"), run_name="__main__")
    assert ended.value.code == 130
