import sys

import pytest

from runtime.errors import UsageError


def test_a_missing_matplotlib_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.axes", None)
    monkeypatch.delitem(sys.modules, "runtime.studies.paper.pictures", raising=False)
    with pytest.raises(UsageError, match=r"pip install 'infant\[review\]'"):
        import runtime.studies.paper.pictures  # noqa: F401
