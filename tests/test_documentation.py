"""What the documents say is so: pages build, links lead somewhere, commands exist and run, references are complete."""

import ast
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from html.parser import HTMLParser
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
import typer

from docs.generate.command_page import error_classes, helps
from docs.generate.pages import PAGES, REFERENCE
from docs.generate.wire_page import ASKED, PUBLISHED
from runtime.cli.__main__ import app
from runtime.health import RunState
from runtime.live.kernels import COMPILE
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.settings.keys import tables
from runtime.source_tree import ROOT
from tests.support.zenoh.wire import free_port, listening, publishing, put_ticks, settings_on, until

DOCS = ROOT / "docs"
FENCED = re.compile(r"(<!-- not run: [^\n]+ -->\n)?^```(\{?\w*\}?)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!\!)\[[^\]]+\]\(([^)\s]+)\)|!\[[^\]]*\]\(([^)\s]+)\)")
JOURNEY = ("journeys/engineer.md", "journeys/reviewer.md", "journeys/ci.md", "maps.md", "ros2.md", "fleet.md")
RUN_S = 900.0  # for one command on a machine that does much else


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: str
    language: str
    text: str
    excused: bool

    @property
    def commands(self) -> list[str]:
        return [line for line in self.text.replace("\\\n", " ").splitlines() if line.strip() and line[0] != "#"]


def written_pages() -> list[Path]:
    of_the_root = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    return [*of_the_root, *sorted(p for p in DOCS.rglob("*.md") if p.parent != REFERENCE)]


def blocks() -> Iterator[Block]:
    for path in written_pages():
        for excuse, language, text in FENCED.findall(path.read_text(encoding="utf-8")):
            yield Block(str(path.relative_to(ROOT)), language, text, bool(excuse))


def infant_lines() -> list[tuple[str, str]]:
    """Every command line of ours in any page, fenced or indented, with the page that has it."""
    found = [(block.page, line) for block in blocks() if block.language in ("sh", "console") for line in block.commands]
    for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("    "):
            found.append(("README.md", line.strip().removeprefix(".venv/bin/")))
    return [(page, line.partition("  #")[0].strip()) for page, line in found if line.startswith("infant ")]


class Anchors(HTMLParser):
    """Ids and links of a page, and what it would fetch when it is looked at."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attributes}
        self.ids |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in ("script", "img", "iframe", "source") and "src" in values:
            self.fetched.append(values["src"])
        if tag == "link" and values.get("rel") not in ("canonical", "index", "search", "next", "prev"):
            self.fetched.append(values.get("href", ""))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("sphinx", reason="sphinx is not installed; make test installs it")
    pytest.importorskip("furo", reason="furo is not installed; make test installs it")
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(folder / "trees")]
    command = [*build, str(DOCS), str(folder / "html")]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_the_pages_build_and_every_link_and_anchor_leads_somewhere(site: Path) -> None:
    pages = {path: Anchors(path) for path in site.rglob("*.html")}
    assert len(pages) > 20
    broken = []
    for path, page in pages.items():
        for link in page.links:
            target, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", target) or path.name in ("genindex.html", "search.html"):
                continue
            there = (path.parent / unquote(target)).resolve() if target else path
            if there.is_dir():
                there /= "index.html"
            if not there.is_file() or (anchor and there in pages and anchor not in pages[there].ids):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_nothing_is_fetched_from_elsewhere_when_a_page_is_looked_at(site: Path) -> None:
    for path in site.rglob("*.html"):
        foreign = [source for source in Anchors(path).fetched if re.match(r"([a-z]+:)?//", source)]
        assert foreign == [], path.name
    for path in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", path.read_text(encoding="utf-8")), path.name


@pytest.mark.parametrize("path", written_pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_a_page_names_are_there(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for target in (first or second for first, second in LINK.findall(text)):
        if re.match(r"[a-z]+:|#", target):
            continue
        assert (path.parent / target.partition("#")[0]).exists(), f"{path.name}: {target}"
    for name in re.findall(r"`((?:config|docs|runtime|slam|drivers|tests|systemd)/[\w./-]+)`", text):
        assert (ROOT / name).exists() or (ROOT / "runtime" / name).exists(), f"{path.name}: {name}"


@pytest.mark.parametrize(("page", "line"), infant_lines())
def test_a_command_that_a_page_shows_exists_with_these_options(page: str, line: str) -> None:
    """Parsed by the command line itself, without being run."""
    command: Any = typer.main.get_command(app)
    words = shlex.split(line.replace("[", "").replace("]", "").replace("...", ""))[1:]
    while hasattr(command, "commands"):
        assert words[0] in command.commands, f"{page}: {line}"
        command = command.commands[words.pop(0)]
    command.make_context(command.name, words)


def test_no_table_has_more_columns_than_a_page_is_wide() -> None:
    rows = [line for path in DOCS.rglob("*.md") for line in path.read_text(encoding="utf-8").splitlines()]
    assert [row for row in rows if row.startswith("|---") and row.count("|") > 13] == []


def test_a_make_target_that_a_page_shows_exists() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for path in (*written_pages(), ROOT / ".pre-commit-config.yaml"):
        shown = re.findall(r"(?:`|^ {4}|entry: )make ([a-z]+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert set(shown) <= targets, path.name


def test_a_block_that_is_not_run_says_why() -> None:
    for block in blocks():
        assert block.language, f"{block.page}: a block without a language: {block.text[:40]!r}"
        assert (block.language == "console") == block.excused, f"{block.page}: {block.text[:60]!r}"


def test_every_page_with_a_block_to_run_is_run() -> None:
    assert {block.page for block in blocks() if block.language == "sh"} <= {f"docs/{name}" for name in JOURNEY}


@pytest.mark.docs
@pytest.mark.timeout(3600)
def test_every_command_of_the_pages_runs(tmp_path: Path) -> None:
    """In one folder and in the order of the journeys, as a reader would type them."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    (tmp_path / "infant").write_text(f'#!/bin/sh\nexec {sys.executable} -m runtime.cli "$@"\n')
    (tmp_path / "infant").chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    lines = [
        (block.page, line)
        for name in JOURNEY
        for block in blocks()
        if block.page == f"docs/{name}" and block.language == "sh"
        for line in block.commands
    ]
    lines += [("README.md", line) for line in readme_lines_on_a_run()]
    assert len(lines) >= 20
    subprocess.run(COMPILE, cwd=ROOT, env=environment, check=True)  # as make does once, not after a change
    for page, line in lines:
        shell = ["sh", "-ec", line]
        done = subprocess.run(
            shell, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=RUN_S, check=False
        )
        assert done.returncode == 0, f"{page}: {line}\n{done.stdout}{done.stderr}"


def readme_lines_on_a_run() -> list[str]:
    """Those of the README that work on any recorded run, with the run of the journeys put in for RUN."""
    shown = [line for page, line in infant_lines() if page == "README.md" and re.search(r"\bRUN\b(?!\.\.\.)", line)]
    on_a_run = [line for line in shown if line.split()[1] in ("replay", "evaluate", "review", "compare", "log")]
    return [line.replace("RUN", "runs/yard").replace("OTHER", "runs/readme") for line in on_a_run]


@pytest.mark.parametrize("name", PAGES)
def test_a_generated_page_in_the_repository_is_current(name: str) -> None:
    assert (REFERENCE / name).read_text(encoding="utf-8") == PAGES[name](), "run 'make reference', commit the result"


def test_every_key_of_the_configuration_stands_in_its_reference_with_its_description() -> None:
    page = PAGES["configuration.md"]()
    missing = []
    for table in tables():
        for name, field in table.leaves():
            if f"| `{name}` |" not in page or (name != "kind" and not field.description):
                missing.append(f"{table.path}.{name}")
    assert missing == []
    assert "typing." not in page
    assert "<class" not in page


def test_a_default_of_the_reference_is_the_one_in_force() -> None:
    page = PAGES["configuration.md"]()
    section = page.partition("### [publish]")[2].partition("\n### ")[0]
    row = next(line for line in section.splitlines() if line.startswith("| `ros2_domain`"))
    assert row.split(" | ")[1:4] == ["whole number, ≥ 0, ≤ 232", "", f"`{Configuration().publish.ros2_domain}`"]
    load_configuration_text("[publish]\nros2_domain = 232\n")


def test_the_help_of_every_command_fits_a_screen() -> None:
    for name, text in helps():
        most = 60 if name == "infant" else 40  # that of `infant` lists every command in a whole sentence
        assert len(text.splitlines()) <= most, f"{name} wants {len(text.splitlines())} lines"


def test_every_command_that_ends_by_itself_can_answer_in_json() -> None:
    for name, text in helps():
        is_group = "COMMAND [ARGS]" in text
        assert is_group or name == "infant sim" or "--json" in text, name


def test_every_command_and_exit_code_stands_in_the_reference() -> None:
    page, troubles = PAGES["commands.md"](), (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    for name in getattr(typer.main.get_command(app), "commands", ()):
        assert f"\n## infant {name}\n" in page
    for error in error_classes():
        assert f"| {error.exit_code} | {error.__name__} |" in page
        assert f"\n| {error.exit_code} | " in troubles
    for state in RunState:
        assert re.search(rf"^\|.*\b{state}\b.*\|", troubles, re.MULTILINE), state


def test_the_keys_of_the_reference_are_those_that_a_rover_says_with_these_encodings() -> None:
    port = free_port()
    said: dict[str, str] = {}
    beats = count(7, 70)  # each seventh tick has an event; seven seconds apart all that is said once a second is due
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**") as listener:

        def complete() -> bool:
            seq = next(beats)
            put_ticks(publisher, range(seq, seq + 1), 0.0)
            said.update({message["key"]: message["encoding"] for message in listener.messages})
            return len(said) >= len(PUBLISHED) - 1

        assert until(complete), said
    wanted = {f"infant/r1/{key.name}": key.encoding for key in PUBLISHED if key.name != "health"}  # no monitor here
    assert {key: said[key] for key in said if not key.endswith("/health")} == wanted
    assert {key.name for key in ASKED} == {"pose", "status", "map", "path", "tf_static", "configuration"}


def test_the_example_reads_the_pose_of_a_rover() -> None:
    port = free_port()
    command = [sys.executable, str(DOCS / "examples" / "read_pose.py"), f"tcp/127.0.0.1:{port}"]
    with publishing(settings_on(port)) as publisher:
        reader = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        beats = count()

        def has_ended() -> bool:
            put_ticks(publisher, range(seq := next(beats), seq + 1), 0.05)
            return reader.poll() is not None

        assert until(has_ended)
        printed = reader.communicate()[0].splitlines()
    assert reader.returncode == 0
    assert [line.split()[0] for line in printed] == ["infant/r1/pose"] * 3
    assert all(len([float(word) for word in line.split()[1:]]) == 6 for line in printed)


def test_the_map_has_every_folder_with_the_question_that_its_door_asks() -> None:
    doors = {
        door.parent.relative_to(ROOT): " ".join((ast.get_docstring(ast.parse(door.read_text())) or "").split())
        for package in ("drivers", "slam", "runtime")
        for door in (ROOT / package).rglob("__init__.py")
    }
    rows = [f"| `{folder}/` | {doors[folder]} |" for folder in sorted(doors)]
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    table = [line for line in page.splitlines() if line.startswith("| `")]
    assert sorted(table) == sorted(rows), "copy the docstrings of the doors into docs/architecture.md"
