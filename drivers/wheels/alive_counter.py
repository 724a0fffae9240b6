"""What a rolling counter and the time between two frames say about the frames in between."""

from collections import deque

LATE_FRAMES = 3  # a frame this much older than the newest is late, not lost
HASTE = 0.3  # frames that come in less than this part of their time ...
AHEAD_FRAMES = 0.7  # ... and were not waited for, are another sender's if they are this far ahead of time
FIRST_CREDIT = 3.0  # the first frame may have waited in a queue itself
CREDIT_KEPT = 0.8  # per frame that comes at its own time: the queue is empty then


class AliveCounter:
    """Judges the rolling counters of one sender. modulus: values of the counter, 0 where none is sent."""

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self._late = min(LATE_FRAMES, modulus // 4 - 1)
        self._recent: deque[tuple[int | None, float | None]] = deque(maxlen=LATE_FRAMES + 1)
        self._credit = FIRST_CREDIT
        self._doubtful = 0

    def restart(self) -> None:
        """Forget the frames so far."""
        self._recent.clear()
        self._credit = FIRST_CREDIT
        self._doubtful = 0

    def steps(self, before: int | None, after: int | None, elapsed: float) -> tuple[int, str | None]:
        """Frames from one to the next, or why the second cannot follow the first. elapsed: in periods."""
        modulus = self._modulus
        if before is None or after is None or not modulus:
            return max(1, round(elapsed)), None
        ahead = (after - before) % modulus
        if ahead == 0 and elapsed < 0.75 * modulus:
            return 0, "alive_frozen"
        if modulus - ahead <= self._late and elapsed < 0.5 * modulus:
            return 0, "out_of_order"
        turns = max(0, round((elapsed - ahead) / modulus))
        return (ahead + turns * modulus) or modulus, None

    def known(self, alive: int | None, position: float | None) -> str:
        """What a frame that is not newer really is: a duplicate, a late one, or another sender's."""
        if (alive, position) in self._recent:
            return "duplicate"
        return "alive_frozen" if any(alive == number for number, _ in self._recent) else "out_of_order"

    def too_soon(self, steps: int, elapsed: float) -> bool:
        """True for a frame that one sender could not have sent yet.

        Frames that waited in a queue come in a bunch too; the time that passed without them is their credit.
        """
        hasty = bool(self._modulus) and elapsed < HASTE * steps
        return hasty and self._credit + elapsed - steps < -AHEAD_FRAMES

    def accept(self, alive: int | None, position: float | None, steps: int, elapsed: float) -> int:
        """Note an accepted frame; returns the number of frames that were surely lost before it.

        Whole turns of the counter are guessed from time, and a queue that is late looks the same: they are
        counted only when the next frame comes at its own time.
        """
        lost = 0
        if elapsed >= 0.5:
            lost, self._doubtful = self._doubtful, 0
        modulus = self._modulus
        turns = (steps - 1) // modulus if modulus else 0
        self._doubtful = self._doubtful * (elapsed >= 0.5) + turns * modulus
        if modulus:
            lost += (steps - 1) - turns * modulus
        elif elapsed > 1.5:
            lost += steps - 1
        gain = elapsed - (steps - turns * modulus)
        if elapsed >= 0.5:
            self._credit = min(CREDIT_KEPT * self._credit + gain, max(FIRST_CREDIT, elapsed))
        else:
            self._credit += gain
        self._recent.append((alive, position))
        return lost
