"""`make firsthour`: the five rovers, one line each; exit code 1 where one does not drive."""

import sys
import tempfile
from pathlib import Path

from runtime.cli.output import say, say_json
from runtime.studies.first_hour.study import study


def main() -> int:
    """Run it; --json prints one object instead."""
    as_json = "--json" in sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="infant-first-hour-") as folder:
        result = study(Path(folder), lambda line: say(line, err=as_json))
    if as_json:
        say_json(result)
    return 0 if result["good"] == len(result["rovers"]) else 1


if __name__ == "__main__":
    sys.exit(main())
