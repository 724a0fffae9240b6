"""What was seeded and what the review said.

python -m tests.support.runtime.confusion [--seeds A-B] [--jobs N] [NAME...]

One row a fault: in how many runs its kind was among the findings above info, in how many it stood first, and what else
was said: as a consequence ("follows" in report.json), or as a fault of its own, which is a false companion.
"""

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from drivers.measurements import Severity
from runtime.report.finding import Finding
from runtime.report.judge import judge
from tests.support.runtime.made_drives import Rover
from tests.support.runtime.seeded_runs import FAULTS, seeded_facts, sweeps

HEALTHY = "healthy"
HEALTHY_S = 30.0


@dataclass(frozen=True, slots=True)
class Said:
    """Findings above info of one run with one seeded fault: kinds in the order of the page, and what each follows."""

    seed: int
    kinds: tuple[str, ...]
    follows: tuple[str, ...]
    titles: tuple[str, ...]

    @property
    def own(self) -> tuple[str, ...]:
        """Kinds that stand for themselves."""
        return tuple(kind for kind, cause in zip(self.kinds, self.follows, strict=True) if not cause)


def grave(findings: Sequence[Finding]) -> list[Finding]:
    """Those above info."""
    return [finding for finding in findings if finding.severity is not Severity.INFO]


def said(name: str, seed: int) -> Said:
    """Seed the fault, judge the run, and keep what was said."""
    rover, fault, duration_s, _ = FAULTS[name] if name != HEALTHY else (Rover(), None, HEALTHY_S, "")
    with tempfile.TemporaryDirectory() as folder:
        told = grave(judge(seeded_facts(Path(folder) / "run", seed, rover, fault, duration_s)))
    sweeps.cache_clear()  # a world and its sweeps are 20 MB, and each seed has its own
    columns = zip(*((finding.kind, finding.follows, finding.title) for finding in told), strict=True)
    return Said(seed, *columns) if told else Said(seed, (), (), ())


def is_named(name: str, run: Said) -> bool:
    """Whether the seeded kind was said; for healthy runs, whether nothing was."""
    return FAULTS[name][3] in run.kinds if name != HEALTHY else not run.kinds


def table_row(name: str, runs: Sequence[Said]) -> str:
    """name | runs | named | named first | consequences | false companions, with how often each was said."""
    kind = FAULTS[name][3] if name != HEALTHY else ""
    named = sum(is_named(name, run) for run in runs)
    first = sum(run.kinds[:1] == (kind,) for run in runs) if kind else named
    follows = Counter(k for run in runs for k in set(run.kinds) - set(run.own) - {kind})
    false = Counter(k for run in runs for k in set(run.own) - {kind})
    cells = (name, kind or "nothing", str(len(runs)), str(named), str(first), _counted(follows), _counted(false))
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| seeded | kind | runs | named | first | said as a consequence | false companions |\n|---|---|---|---|---|---|---|"
)


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{kind} {count}" for kind, count in counts.most_common()) or "-"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the table to standard output, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=[*FAULTS, HEALTHY], metavar="NAME")
    parser.add_argument("--seeds", default="10-19", help="first and last seed")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--titles", action="store_true", help="also every title")
    options = parser.parse_args(arguments)
    first, last = map(int, options.seeds.split("-"))
    sys.stdout.write(HEAD + "\n")
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.names:
            runs = list(pool.map(partial(said, name), range(first, last + 1)))
            sys.stdout.write(table_row(name, runs) + "\n")
            for run in runs if options.titles else ():
                sys.stdout.write(f"    {run.seed}: {'; '.join(run.titles) or 'nothing'}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
