"""How often each kind of foreign bytes hurt us: python -m tests.support.mutations [KIND...] [--share 1.0] [--first 0].

Prints a line a kind: files or messages tried, and how many ended with exit code 70, hung, took more memory or ended a
thread. Each case is made from a seed. Exit code 1 where anything was hurt.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from importlib import import_module

from tests.support.mutations import kinds
from tests.support.mutations.commands import HURTS, Tally, run_batches


def _on_wires(name: str) -> Callable[[range], Iterator[Tally]]:
    """Imported where it runs: zenoh, python-can and pytest are no part of a command's memory."""
    return lambda seeds: getattr(import_module("tests.support.mutations.wires"), name)(seeds)


KINDS: dict[str, tuple[int, Callable[[range], Iterator[Tally]]]] = {
    "configurations": (5000, lambda seeds: run_batches(kinds.configuration, seeds)),
    "runs": (5000, kinds.runs),
    "descriptions and recordings": (5000, lambda seeds: run_batches(kinds.recording, seeds)),
    "SCIP replies": (20_000, _on_wires("replies")),
    "CAN frames": (100_000, _on_wires("frames")),
    "zenoh payloads": (5000, _on_wires("payloads")),
}


def tried(kind: str, first: int, share: float) -> Tally:
    count, run = KINDS[kind]
    whole = Tally()
    for tally in run(range(first, first + max(1, round(count * share)))):
        whole.add(tally)
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{kind}: {whole.tried}")
    return whole


def row(kind: str, tally: Tally) -> str:
    hurts = "  ".join(f"{name} {len(tally.hurt[name])}" for name in HURTS)
    codes = ", ".join(f"{code}: {count}" for code, count in sorted(tally.codes.items()))
    return f"{kind:28s} {tally.tried:7d} tried  {hurts}  (at most {tally.longest_s:.1f} s, {tally.most_mb:.0f} MB" + (
        f"; exit codes {codes})" if codes else ")"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--share", type=float, default=1.0, help="of the figures")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    words = parser.parse_args()
    is_hurt = False
    for kind in words.kinds or KINDS:
        tally = tried(kind, words.first, words.share)
        sys.stdout.write(row(kind, tally) + "\n")
        for cases in tally.hurt.values():
            for case in cases:
                is_hurt = True
                sys.stdout.write(f"    {case}\n")
        sys.stdout.flush()
    return int(is_hurt)


if __name__ == "__main__":
    sys.exit(main())
