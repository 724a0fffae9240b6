"""The pages of the documentation that are made and not written: python -m docs.generate.pages FOLDER."""

import sys
from pathlib import Path

from docs.generate.command_page import command_page
from docs.generate.configuration_page import configuration_page
from docs.generate.wire_page import wire_page

PAGES = {"configuration.md": configuration_page, "wire.md": wire_page, "commands.md": command_page}


def write_pages(folder: Path) -> None:
    """Make them in a folder; one that has not changed is left alone."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        path, text = folder / name, page()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
