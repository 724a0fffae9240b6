"""The English that a user reads, as plain text: pages, help of the commands, sentences in the source."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from docs.generate.command_page import commands
from runtime.source_tree import ROOT

DOCS = ROOT / "docs"
PACKAGES = ("drivers", "slam", "runtime")
HISTORY = (DOCS / "decisions", DOCS / "reference", DOCS / "results", DOCS / "examples")
"""Records that are never rewritten, tables of figures, and pages that are made of what is read here anyway."""
DEFINITIONS = ROOT / "runtime" / "messages" / "definitions.py"  # of messages, in a language of their own
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
CODE = re.compile(r"`[^`\n]+`")
SENTENCE = re.compile(r"[.:;!?](?:\s+|$)")
WORDS_OF_A_SENTENCE = 3  # a literal with fewer is a name, a key or a format


def pages() -> list[Path]:
    """Every page that people write and rewrite."""
    of_the_root = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    return of_the_root + sorted(path for path in DOCS.rglob("*.md") if not set(HISTORY) & set(path.parents))


def page_text(path: Path) -> str:
    """Its prose, a paragraph or a cell of a table on each line; code is an ellipsis."""
    text = COMMENT.sub("", FENCE.sub("", path.read_text(encoding="utf-8")))
    text = CODE.sub("…", LINK.sub(r"\1", re.sub(r"^ {4}\S.*$", "", text, flags=re.MULTILINE)))
    text = re.sub(r"^(\|.*)$", lambda row: "\n" + re.sub(r"\s*\|\s*", ".\n", row[0]) + "\n", text, flags=re.MULTILINE)
    text = re.sub(r"^\s*(?:[-#]+|\d+\.)\s+", "\n", text, flags=re.MULTILINE).replace("**", "").replace("*", "")
    parts = (" ".join(part.split()) for part in re.split(r"\n\s*\n", text) if part.strip(" .\n|-"))
    return plain("\n".join(part if part[-1] in ".:;!?" else f"{part}." for part in parts))


def plain(text: str) -> str:
    """Numbers such as 30 000 and names such as NE are no words."""
    return re.sub(r"\b[A-Z]{2,}\b", "…", re.sub(r"(?<=\d) (?=\d{3}\b)", "", text))


def help_texts() -> Iterator[tuple[str, str]]:
    """Name of each command, with its own help and that of each option."""
    for name, command in commands():
        for text in (command.help, *(getattr(option, "help", None) for option in command.params)):
            yield name, plain(" ".join((text or "").split()))


def sentences_of_the_source() -> Iterator[tuple[str, str]]:
    """Place and text of every literal that is a sentence: errors, findings, remedies, events; not the docstrings."""
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        if path == DEFINITIONS:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
        inner |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr) or (id(node) not in inner and isinstance(node, ast.Constant)):
                text = plain(_text_of(node))
                if len(re.findall(r"[a-z]{2,}", text)) >= WORDS_OF_A_SENTENCE and " " in text:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", text


def _text_of(node: ast.AST) -> str:
    if isinstance(node, ast.JoinedStr):
        return "".join(_text_of(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return "…"
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
