"""A notebook as a page: its cells in the order of the file, with the outputs that it holds, as MyST takes them."""

import json
from typing import Any

from myst_parser.parsers.sphinx_ import MystParser


class NotebookParser(MystParser):
    """What Sphinx parses files ending in .ipynb with."""

    supported = ("ipynb",)

    def parse(self, inputstring: str, document: Any) -> None:
        """As Markdown."""
        super().parse(as_markdown(json.loads(inputstring)), document)


def as_markdown(notebook: dict[str, Any]) -> str:
    """Text as it is, code as Python, what it printed as text, and pictures inside the page."""
    parts: list[str] = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            if "text" in output:
                parts.append(f"```text\n{''.join(output['text'])}```")
            if picture := output.get("data", {}).get("image/png"):
                parts.append(f'<img alt="What the lines above draw" src="data:image/png;base64,{picture.strip()}">')
    return "\n\n".join(parts) + "\n"
