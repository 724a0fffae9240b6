"""The list of decision records is complete, and a number means one record."""

import re
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs" / "decisions"
ROW = re.compile(r"^\| (?:\[(\d+)\]\(([\w-]+\.md)\)|(\d+)) \| (.+?) \| (.+?) \|$", re.MULTILINE)


def rows() -> list[tuple[int, str, str]]:
    """Number, file (empty where the number is not used) and title of each line of the list."""
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    return [(int(number or unused), file, title) for number, file, unused, title, _ in ROW.findall(text)]


def test_each_record_stands_in_the_list_with_its_number_and_title() -> None:
    records = {}
    for path in FOLDER.glob("[0-9]*.md"):
        heading = re.match(r"# (\d+)\. (.+)\n", path.read_text(encoding="utf-8"))
        assert heading is not None, path.name
        assert path.name.startswith(f"{int(heading[1]):04d}-"), path.name
        records[path.name] = (int(heading[1]), heading[2])
    assert {file: (number, title) for number, file, title in rows() if file} == records


def test_the_numbers_have_no_gap_that_is_not_explained() -> None:
    listed = rows()
    assert [number for number, _, _ in listed] == list(range(1, len(listed) + 1))
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    for number, file, _ in listed:
        assert file or f"**Number {number}** " in text, f"number {number} is not used, and nothing says why"
