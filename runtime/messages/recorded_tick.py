"""One tick of a recorded run: what came in, and what came of it."""

from collections.abc import Callable
from dataclasses import dataclass, field

from runtime.messages.decoding import Decoded, decoded
from runtime.messages.estimate import decode_estimate
from runtime.messages.tick import Gap, Record, decode_defect, decode_state_hash, decode_timing, decode_truth
from runtime.tick import Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

OUTCOMES = frozenset(("/estimate", "/pose", "/odom", "/timing", "/state_hash", "/truth", "/defect"))


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """One tick as it came in and, where it was recorded, what came of it.

    inputs: the records that the tick was decoded from, for whoever writes it again unchanged.
    outcomes: the others by topic, decoded only when asked for, which raises NotARunError where they are none.
    gaps: what the record had lost before this tick. place: file and byte of its chunk.
    """

    tick: Tick
    inputs: list[Record]
    gaps: list[Gap]
    place: str
    outcomes: dict[str, Record] = field(default_factory=dict)

    @property
    def estimate(self) -> Estimate | None:
        """What the estimator said."""
        return self._outcome("/estimate", lambda data: decode_estimate(data, self.tick.beams))

    @property
    def timing(self) -> Timing | None:
        """How the loop kept time."""
        return self._outcome("/timing", decode_timing)

    @property
    def state_hash(self) -> bytes | None:
        """Hash of the filter's state after the tick."""
        return self._outcome("/state_hash", decode_state_hash)

    @property
    def truth(self) -> Pose2 | None:
        """Where a simulated rover really was."""
        return self._outcome("/truth", decode_truth)

    @property
    def defect(self) -> str:
        """Why the step raised and ended as a prediction, "" where it did not."""
        return self._outcome("/defect", decode_defect) or ""

    def _outcome(self, topic: str, decoder: Callable[[bytes], Decoded]) -> Decoded | None:
        record = self.outcomes.get(topic)
        return None if record is None else decoded(record, decoder, self.place)
