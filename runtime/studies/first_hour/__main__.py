"""`make firsthour`: the five rovers, one line each; exit code 1 where one does not drive."""

import json
import sys
import tempfile
from pathlib import Path

from runtime.studies.first_hour.study import study


def main() -> int:
    """Run it; --json prints one object instead."""
    as_json = "--json" in sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="infant-first-hour-") as folder:
        result = study(Path(folder), lambda line: (sys.stderr if as_json else sys.stdout).write(f"{line}\n"))
    if as_json:
        sys.stdout.write(f"{json.dumps(result)}\n")
    return 0 if result["good"] == len(result["rovers"]) else 1


if __name__ == "__main__":
    sys.exit(main())
