"""How a command ends is what a service manager decides by."""

import pytest

from runtime import errors
from runtime.cli import __main__ as cli
from runtime.errors import InfantError


def family(error: type[InfantError]) -> list[type[InfantError]]:
    return [error, *(each for child in error.__subclasses__() for each in family(child))]


def ends_with(monkeypatch: pytest.MonkeyPatch, error: Exception) -> int:
    def fail(standalone_mode: bool) -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    code: int = ended.value.code  # type: ignore[assignment]
    return code


@pytest.mark.parametrize("error", family(InfantError), ids=lambda error: error.__name__)
def test_an_error_of_the_family_ends_with_its_sentence_and_code(
    error: type[InfantError], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends_with(monkeypatch, error("what it is")) == error.exit_code
    assert capsys.readouterr().err == "infant: what it is\n"


def test_codes_are_those_that_the_design_fixes() -> None:
    assert {each.exit_code for each in family(errors.InfantError)} == {2, 3, 4, 5, 6, 70, 130}


def test_a_defect_ends_with_70_and_its_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends_with(monkeypatch, ZeroDivisionError("a defect")) == 70
    assert "ZeroDivisionError: a defect" in capsys.readouterr().err
