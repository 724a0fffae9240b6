"""Console entry point: refuses to start where another package owns one of our top-level names, and says which."""

import importlib.util
import json
import sys
from pathlib import Path
from typing import NoReturn

PACKAGES = ("drivers", "runtime", "slam")


def foreign_packages(home: Path) -> list[str]:
    """One sentence for each of our packages that Python would import from another folder than `home`."""
    sentences = []
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        places = [Path(place).resolve() for place in (spec.submodule_search_locations or ())] if spec else []
        if home / name not in places[:1]:
            place = places[0] if places else (spec.origin if spec else None) or "nowhere"
            sentences.append(f"package {name} would be imported from {place}, not from {home / name}")
    return sentences


def end(exit_code: int, reason: str) -> NoReturn:
    """End before there is a command line; a program that asked for JSON is told why in JSON."""
    if "--json" in sys.argv[1:]:
        sys.stdout.write(json.dumps({"error": {"exit_code": exit_code, "reason": reason}}) + "\n")
    sys.exit(exit_code)


def main() -> None:
    """Run the command line, or end with exit code 70 and a sentence for each package that is not ours."""
    foreign = foreign_packages(Path(__file__).resolve().parent)
    if foreign:
        sentences = [*foreign, "install infant into a virtual environment of its own, and check PYTHONPATH"]
        sys.stderr.writelines(f"infant: {sentence}\n" for sentence in sentences)
        end(70, "; ".join(sentences))
    try:
        from runtime.cli.__main__ import main as run_command_line  # only now is it known to be ours

        run_command_line()
    except KeyboardInterrupt:  # while packages are loaded
        end(130, "interrupted by Ctrl-C")


if __name__ == "__main__":
    main()
