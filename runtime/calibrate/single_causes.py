"""Which few deviations from the start explain a drive: few things break at once, so few are presumed.

With all parameters free, each pays for the doubt about all others: an unequal pair of wheels must be distinguished
from a wrong tread, mount and latency at once. A single cause is surer: the slip of one wheel alone stands against it.
From the free estimate d and its information A, the deviation of greatest likelihood along one direction v is v'Ad /
v'Av, and v'Ad / sqrt(v'Av) is standard normal where nothing deviates. The most significant cause is taken, then the
most significant of what is left, until none is significant.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from drivers.measurements import FloatArray

FALSE_ALARM = 0.0005  # of one cause where nothing deviates (3.5 deviations): eight causes make 1 in 250 healthy drives
RIVAL = 6.0  # difference of squared deviations below which the data prefer one cause to another by less than 20 to 1
DEPENDENT = 1e-6  # share of its information that a cause keeps beside those taken; with less it is a mixture of them


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """names of all parameters; start, values (p,); covariance (p, p); steps: pieces of way that it rests on."""

    names: tuple[str, ...]
    start: FloatArray
    values: FloatArray
    covariance: FloatArray
    steps: int

    @property
    def sure(self) -> float:
        """Deviations from which on a cause is significant: Student's, for the noise was estimated from the same steps.

        Each step speaks of the slip of two wheels.
        """
        return -float(stdtrit(max(2 * self.steps - len(self.names), 3), 0.5 * FALSE_ALARM))

    def direction(self, shares: Mapping[str, float]) -> FloatArray:
        """(p,) from shares by name. Raises ValueError where there is no such parameter."""
        direction = np.zeros(len(self.names))
        for name, share in shares.items():
            direction[self.names.index(name)] = share
        return direction

    def detectable(self, direction: FloatArray) -> float:
        """Least deviation along a direction that this drive shows as significant in one of two cases."""
        return self.sure / float(np.sqrt(direction @ np.linalg.inv(self.covariance) @ direction))


@dataclass(frozen=True, slots=True)
class Cause:
    """value along its direction and its standard deviation, beside the other causes; significance: deviations when it
    was taken; rivals: causes that would have explained the drive nearly as well in its place.
    """

    name: str
    value: float
    deviation: float
    significance: float
    rivals: tuple[str, ...]


def single_causes(fit: Fit, directions: Mapping[str, FloatArray]) -> tuple[Cause, ...]:
    """The significant causes among these directions (p,) by name, the most significant first."""
    information = np.asarray(np.linalg.inv(fit.covariance), dtype=np.float64)
    pull = information @ (fit.values - fit.start)
    taken: list[tuple[str, float, tuple[str, ...]]] = []
    others = dict(directions)
    while True:
        chosen = np.array([directions[name] for name, *_ in taken]).reshape(len(taken), len(fit.start))
        scores = _scores(information, pull, chosen, others)
        best = max(scores, key=lambda name: abs(scores[name]), default="")
        if not best or abs(scores[best]) < fit.sure:
            break
        rivals = tuple(name for name in scores if name != best and scores[best] ** 2 - scores[name] ** 2 < RIVAL)
        taken.append((best, scores[best], rivals))
        del others[best]
    if not taken:
        return ()
    covariance = np.linalg.inv(chosen @ information @ chosen.T)
    values, deviations = covariance @ chosen @ pull, np.sqrt(np.diag(covariance))
    return tuple(
        Cause(name, float(value), float(deviation), abs(score), rivals)
        for (name, score, rivals), value, deviation in zip(taken, values, deviations, strict=True)
    )


def _scores(
    information: FloatArray, pull: FloatArray, chosen: FloatArray, others: Mapping[str, FloatArray]
) -> dict[str, float]:
    """Significance, with its sign, of each of the others beside those chosen (m, p)."""
    scores = {}
    between = np.linalg.inv(chosen @ information @ chosen.T) if len(chosen) else np.zeros((0, 0))
    for name, direction in others.items():
        shared = chosen @ information @ direction
        alone = float(direction @ information @ direction)
        left = alone - float(shared @ between @ shared)
        if left > DEPENDENT * alone:
            scores[name] = float(direction @ pull - shared @ between @ (chosen @ pull)) / left**0.5
    return scores
