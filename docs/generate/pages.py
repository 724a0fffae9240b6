"""The pages of the documentation that are generated and kept in the repository: python -m docs.generate.pages."""

from docs.generate.command_page import command_page
from docs.generate.configuration_page import configuration_page
from docs.generate.wire_page import wire_page
from runtime.source_tree import ROOT

PAGES = {"configuration.md": configuration_page, "wire.md": wire_page, "commands.md": command_page}
REFERENCE = ROOT / "docs" / "reference"


if __name__ == "__main__":
    for name, page in PAGES.items():
        (REFERENCE / name).write_text(page(), encoding="utf-8")
