"""infant map merge: two maps of places that overlap become one."""

from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import ConfigurationError, NotAMapError, UsageError
from runtime.map_files.end import facts_of
from runtime.map_files.fitness import configuration_of, suits
from runtime.map_files.map_file import encode_map
from runtime.map_files.map_store import read_map, refuse_taken, write_new_map
from slam.recognise.attempt import ODDS
from slam.relocalise.merge import merge_maps

MOST_LANDMARKS = 2000  # of each map: all pairs are compared, in 130 MB


def merge_files(first: Path, second: Path, out: Path) -> dict[str, Any]:
    """The command; the frame is that of the first map. Returns its summary.

    Raises NotAMapError, ConfigurationError where they are of different sensors, RunExistsError, StorageError, and
    UsageError where no place of the second map is recognised in the first.
    """
    refuse_taken(out)
    (into, _), (other, _) = read_map(first), read_map(second)
    for path, saved in ((first, into), (second, other)):
        if len(saved.joint) > MOST_LANDMARKS:
            raise UsageError(
                f"{path} has {len(saved.joint)} landmarks, maps to merge have at most {MOST_LANDMARKS} each; "
                "merge maps of shorter drives"
            )
    configuration = configuration_of(into, str(first))
    fitness = suits(other, str(second), configuration)
    if fitness.refusal:
        raise ConfigurationError(fitness.refusal)
    try:
        merged = merge_maps(configuration.slam, into.joint, other.joint)
    except np.linalg.LinAlgError as error:
        raise NotAMapError(
            f"the uncertainties in {first} and {second} cannot be used ({error}); take other copies"
        ) from error
    found = merged.found
    if merged.joint is None:
        raise UsageError(
            f"no place of {second} is recognised in {first}: at best {len(found.known)} landmarks fit, odds "
            f"{max(found.odds, -99.0):.0f} where {ODDS:.0f} are needed; drive from one to the other with "
            f"--map {first}"
        )
    facts = facts_of(configuration, other.facts.runs, into)
    data = encode_map(merged.joint, facts)
    write_new_map(out, data)
    return {
        "out": str(out),
        "landmarks": [len(into.joint), len(other.joint), len(merged.joint)],
        "odds": round(found.odds, 1),
        "mirror_odds": round(max(found.mirror_odds, -99.0), 1),
        "probability_wrong": found.probability_wrong,
        "matches": len(found.known),
        "bytes": len(data),
        "notes": list(fitness.notes),
    }


def merge_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    first, second, both = summary["landmarks"]
    lines = [
        f"map       {summary['out']}  {both} landmarks, of {first} and {second}",
        f"place     {summary['matches']} landmarks are the same; odds {summary['odds']:g}, by chance "
        f"{summary['mirror_odds']:g}; wrong with a probability of at most {summary['probability_wrong']:g}",
    ]
    return lines + [f"note      {note}" for note in summary["notes"]]
