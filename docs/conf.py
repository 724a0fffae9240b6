"""Sphinx makes the pages: `make docs`. Nothing is fetched when they are looked at."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent.parent))  # Sphinx is started with the folder of the pages

project = "Infant"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown", ".ipynb": "ipynb"}
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "Infant"
html_show_copyright = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["tables.css"]
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
nitpicky = True


def setup(app: Sphinx) -> None:
    """Notebooks are pages too."""
    from docs.generate.notebook import NotebookParser

    app.add_source_parser(NotebookParser)
