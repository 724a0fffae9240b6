"""infant map info and check: what a saved map holds, and whether it can be trusted."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import ConfigurationError
from runtime.map_files.fitness import findings, suits
from runtime.map_files.map_store import read_map
from runtime.settings.configuration import load_configuration


def map_info(path: Path) -> dict[str, Any]:
    """The facts of a map as --json prints them. Raises NotAMapError."""
    saved, data = read_map(path)
    joint, facts = saved.joint, saved.facts
    low, high = joint.means_m.min(axis=0), joint.means_m.max(axis=0)
    sigmas = np.sqrt(np.maximum(np.linalg.eigvalsh(joint.landmarks.covariances_m2)[:, -1], 0.0))
    return {
        "map": str(path),
        "sha256": saved.sha256,
        "bytes": len(data),
        "created_utc": facts.created_utc,
        "frame": facts.frame,
        "origin": None if facts.origin is None else facts.origin.model_dump(),
        "rover": facts.rover,
        "runs": list(facts.runs),
        "predecessor": facts.predecessor or None,
        "configuration_sha256": hashlib.sha256(facts.configuration_text.encode()).hexdigest(),
        "landmarks": len(joint),
        "landmarks_with_joint_covariance": joint.in_state,
        "views": len(joint.views),
        "low_m": low.round(2).tolist(),
        "high_m": high.round(2).tolist(),
        "sigma_m": {"median": round(float(np.median(sigmas)), 3), "max": round(float(sigmas.max()), 3)},
    }


def check_map(path: Path, config: Path | None) -> dict[str, Any]:
    """Read every byte; with a configuration also whether its rover can use the map.

    Raises NotAMapError, and ConfigurationError where the map is another sensor's.
    """
    saved, _ = read_map(path)
    notes: tuple[str, ...] = ()
    if config is not None:
        fitness = suits(saved, str(path), load_configuration(config))
        if fitness.refusal:
            raise ConfigurationError(fitness.refusal)
        notes = fitness.notes
    return {
        "map": str(path),
        "sha256": saved.sha256,
        "landmarks": len(saved.joint),
        "findings": findings(saved),
        "differences": list(notes),
    }


def info_lines(facts: dict[str, Any]) -> list[str]:
    """The facts for a person."""
    (low_x, low_y), (high_x, high_y) = facts["low_m"], facts["high_m"]
    lines = [
        f"map       {facts['map']}  {facts['bytes'] / 1e3:.0f} kB  {facts['created_utc']}  rover {facts['rover']}",
        f"landmarks {facts['landmarks']}, sigma {facts['sigma_m']['median']:g} m (median), "
        f"{facts['sigma_m']['max']:g} m (largest)",
        f"views     {facts['views']}, by which walls are recognised",
        f"extent    x {low_x:g} to {high_x:g} m, y {low_y:g} to {high_y:g} m in the frame {facts['frame']}",
        f"runs      {', '.join(facts['runs'])}",
        f"sha256    {facts['sha256']}",
    ]
    if (origin := facts["origin"]) is not None:
        lines.append(
            f"origin    {origin['latitude_deg']:.7f} N, {origin['longitude_deg']:.7f} E, its x axis "
            f"{origin['heading_deg']:g} degrees from east towards north"
        )
    return lines + ([f"before    {facts['predecessor']}"] if facts["predecessor"] else [])


def check_lines(result: dict[str, Any]) -> list[str]:
    """The check for a person."""
    lines = [f"intact    {result['map']}: {result['landmarks']} landmarks, sha256 {result['sha256']}"]
    lines += [f"finding   {sentence}" for sentence in result["findings"]]
    return lines + [f"differs   {sentence}" for sentence in result["differences"]]
