"""Looks for the rover's place by the landmarks around it: one attempt after the other, in each map in turn.

While the pose is believed, every REVISIT_M; in doubt, as often as there is something new.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from slam.joint.gaussian import JointGaussian
from slam.pose import Pose2
from slam.recognise.attempt import NOTHING
from slam.recognise.confirmation import Confirmation
from slam.recognise.prior import PosePrior
from slam.recognise.scale import Scale
from slam.relocalise.island import Island
from slam.relocalise.search import Place, Search, ToldPlace, begin_search

REVISIT_M = 10.0  # between attempts while the pose is believed
CONFIRM_M = 5.0  # the same after one that may be right
ATTEMPT_NS = 500_000_000  # between attempts in doubt


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """The maps: here and others. source: what is around the rover. awaits_saved: it knows no place in the saved one."""

    here: Island
    others: Sequence[Island]
    source: JointGaussian
    awaits_saved: bool


class ByLandmarks:
    """best: what the last attempt came to."""

    def __init__(self, scale: Scale) -> None:
        self._scale = scale
        self._search: Search | None = None
        self._told: ToldPlace | None = None
        self._refusal = ""
        self._since_attempt_m, self._attempt_ns, self._turn = 0.0, 0, 0
        self.best = NOTHING

    def follow(self, increment: Pose2) -> None:
        """The rover has moved and looked around."""
        if self._told is not None:
            self._told.follow(increment)
        self._since_attempt_m += math.hypot(increment.x_m, increment.y_m)

    def tell(self, prior: PosePrior) -> None:
        """Somebody says where the rover was at its last scan."""
        self._told, self._search = ToldPlace(prior), None

    @property
    def is_told(self) -> bool:
        """Whether it is looked for where somebody says that it is."""
        return self._told is not None

    def take_refusal(self) -> str:
        """Why what somebody said is not believed, once; "" where nothing was refused."""
        refusal, self._refusal = self._refusal, ""
        return refusal

    def step(self, stamp_ns: int, known: Known, *, may_begin: bool) -> Place | None:
        """Begin an attempt where one is due, or go on with it."""
        if self._search is None and may_begin:
            self._search = self._next(stamp_ns, known)
        if self._search is None:
            return None
        found = self._search.attempt.advance()
        if found is None:
            return None
        search, self._search = self._search, None
        self.best = found
        place = Place(search.island, search.source, search.frame_from_body, found)
        if search.is_told:
            return place if self._told is not None and self._told.add(found) else None
        if search.island.confirmation.add(found, search.frame_from_body):
            return place
        if not search.whole:
            self._search = begin_search(self._scale, search.source, search.island, whole=True)
        return None

    def forget(self, islands: Sequence[Island]) -> None:
        """The source is another one: what it reached says nothing of this one."""
        self._search = None
        self.best, self._attempt_ns = NOTHING, 0
        for island in islands:
            island.confirmation, island.tried = Confirmation(), ()

    def restart(self, islands: Sequence[Island]) -> None:
        """The rover goes on elsewhere."""
        self.forget(islands)
        self._told = None
        self._since_attempt_m = 0.0

    @property
    def progress(self) -> str:
        """For people."""
        odds = f"best odds {self.best.odds:.0f}" if math.isfinite(self.best.odds) else "too few to tell"
        return f"{self.best.points} landmarks seen, {odds}"

    @property
    def figures(self) -> dict[str, float]:
        """For the record: what the last attempt reached, and what its mirror image did."""
        odds = {"search_odds": self.best.odds, "search_mirror_odds": self.best.mirror_odds}
        reached = {name: value if math.isfinite(value) else 0.0 for name, value in odds.items()}
        return {"search_landmarks": float(self.best.points), **reached}

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash."""
        progress = () if self._search is None else self._search.attempt.state
        numbers = (self._turn, self._attempt_ns, *progress)
        told = b"" if self._told is None else struct.pack("<2q3d", *self._told.state, *self._told.prior.pose.as_array())
        lengths = struct.pack("<dd", self._since_attempt_m, self.best.odds)
        return struct.pack(f"<{len(numbers)}q", *numbers) + lengths + told

    def _next(self, stamp_ns: int, known: Known) -> Search | None:
        """What is looked for, and in which map: they take turns."""
        if self._told is not None:
            return self._next_told(self._told, known)
        here, is_believed = known.here, known.source is known.here.joint
        islands = [here, *known.others]
        if is_believed:
            is_due = self._since_attempt_m >= (CONFIRM_M if self.best.acceptable else REVISIT_M)
            others = [] if here.is_saved else [*known.others]
            islands = [here, *others] if is_due else others
        if not islands or (stamp_ns - self._attempt_ns < ATTEMPT_NS and self._attempt_ns <= stamp_ns):
            return None
        island = islands[self._turn % len(islands)]
        self._turn += 1
        self._attempt_ns = stamp_ns
        if is_believed and island is here:
            self._since_attempt_m = 0.0
        return begin_search(self._scale, known.source, island, whole=False)

    def _next_told(self, told: ToldPlace, known: Known) -> Search | None:
        """Look where the rover is said to be; that ends when it was looked for long enough."""
        self._refusal = told.refusal
        if self._refusal:
            self._told = None
            return None
        saved = next((island for island in known.others if known.awaits_saved and island.is_saved), known.here)
        return told.begin(self._scale, known.source, saved) if known.source is not saved.joint else None
