"""The notebook says what its cells print, and becomes a page with all of it."""

import contextlib
import io
import json
from typing import Any

import matplotlib as mpl
import pytest

from docs.generate.notebook import as_markdown
from runtime.source_tree import ROOT

NOTEBOOK = json.loads((ROOT / "docs" / "examples" / "drive_in_a_notebook.ipynb").read_text(encoding="utf-8"))
CODE = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_every_cell_prints_what_stands_below_it_and_draws_a_picture_where_one_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    shown: list[Any] = []
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf()))
    names: dict[str, Any] = {}
    for cell in CODE:
        shown.clear()
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec("".join(cell["source"]), names)  # noqa: S102 the notebook is ours
        told = "".join(line for output in cell["outputs"] for line in output.get("text", ()))
        assert printed.getvalue() == told, cell["id"]
        assert bool(shown) == any("image/png" in output.get("data", ()) for output in cell["outputs"]), cell["id"]
    plt.close("all")


def test_the_page_has_text_code_outputs_and_the_picture_in_their_order() -> None:
    page, at = as_markdown(NOTEBOOK), 0
    for cell in NOTEBOOK["cells"]:
        at = page.index("".join(cell["source"]), at)
        for output in cell.get("outputs", ()):
            at = page.index("".join(output.get("text", "data:image/png;base64,")), at)
    assert page.count("<img") == 1
    assert page.count("```python") == len(CODE)
