"""Fixed transforms between the frames of a robot, as /tf_static tells them."""

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from drivers.measurements import FloatArray

Transforms = Mapping[tuple[str, str], FloatArray]
"""(parent, child): parent_from_child, (4, 4)."""


def matrix(translation: tuple[float, float, float], quaternion: tuple[float, float, float, float]) -> FloatArray:
    """(4, 4) of a translation m and a quaternion x, y, z, w of any length."""
    x, y, z, w = np.array(quaternion) / max(math.hypot(*quaternion), 1e-12)
    whole = np.eye(4)
    whole[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    whole[:3, 3] = translation
    return whole


def between(transforms: Transforms, target: str, source: str) -> FloatArray | None:
    """target_from_source along the shortest chain, None where the frames do not hang together."""
    steps: dict[str, list[tuple[str, FloatArray]]] = {}
    for (parent, child), parent_from_child in transforms.items():
        steps.setdefault(parent, []).append((child, parent_from_child))
        child_from_parent: FloatArray = np.linalg.inv(parent_from_child).astype(np.float64)
        steps.setdefault(child, []).append((parent, child_from_parent))
    found = {target: np.eye(4)}
    waiting = deque([target])
    while waiting and source not in found:
        frame = waiting.popleft()
        for following, step in steps.get(frame, ()):
            if following not in found:
                found[following] = found[frame] @ step
                waiting.append(following)
    return found.get(source)
