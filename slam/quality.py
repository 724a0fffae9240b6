"""Whether the published pose can be believed: tracking, uncertain or lost, from what the filter itself sees.

What counts are landmarks that were settled before any doubt began: after a kidnapping the filter soon finds a new map
around the wrong pose, and that map agrees with it. The effective number of particles is not asked: it is as low on a
good drive as on a lost one.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.elementary import logarithm, squared
from slam.estimate import Quality
from slam.joint.evidence import SETTLED_SCANS, Evidence
from slam.settings.quality import QualitySettings

FOUND_SHARE = 0.03  # of the settled landmarks in view, over some scans; where less is found, chance finds it
SEEN_BEFORE_SHARE = 0.2  # of the beams that could be compared with earlier scans; where less agrees, the laser is blind
SUPPORTS = -3.0  # log-odds against a pose that a scan supports, whoever walks by: two landmarks found and none missed
LOST_BLIND_SCANS = 20  # scans in a row that do not support the pose; then the map is left as it is
UNCERTAIN_GAPS, LOST_GAPS = 2.0, 4.0  # usual gaps between scans that a laser is silent before it is called blind
GAP_STEP = 1.1  # factor by which the usual gap follows each gap: to the median of them
UNCERTAIN_M = 1.0  # standard deviation of the position, larger axis
LOST_M = 5.0  # the same
UNCERTAIN_GAP_M = 1.5  # m between particles and joint Gaussian beyond 3 sigma of it
UNCERTAIN_SQUARE = 8.0  # mean squared Mahalanobis distance of what is found, over a second; 2 is consistent
LOST_SIGMA_M = 10.0  # m; standard deviation that is added to the published position while it is lost
LOST_SIGMA_RAD = 1.8  # rad; the same for the heading: any heading is as likely as any other
LOST_GROWTH = np.diag((squared(LOST_SIGMA_M), squared(LOST_SIGMA_M), squared(LOST_SIGMA_RAD)))
TOLD_SHARE = (
    0.5  # of lost_score, where somebody says where the rover is: before the first scan no wheel can have slipped
)
CEILING = 1.5  # times the bound: what the score can pile up, so that a rover that finds itself says so soon
FADING = 0.02  # of the score a scan while nothing of the map is in view: it neither speaks for the pose nor against it
LIES_ON_MAP = logarithm(0.02 / 0.6)  # log-odds where a scan lies on the map: from a wrong pose and from a right one
CONSISTENT = 2.0  # expected squared distance of a range and a bearing
SMOOTHING = 0.1  # weight of one scan in the mean squared distance: it looks back a second
QUICKLY = 0.3  # weight of one scan in what is known and found: one chance find in ten scans is not support


@dataclass(frozen=True, slots=True)
class Judgement:
    """Quality with its reason, "" while tracking; the words before the colon name it, figures follow."""

    quality: Quality
    doubt: str = ""


class QualityMonitor:
    """Adds up the evidence of scan after scan."""

    def __init__(
        self, settings: QualitySettings, scans: int = 0, *, silence_is_blind: bool = True, is_told: bool = False
    ) -> None:
        """scans: how many there were before, where a drive begins in a map. silence_is_blind: a laser sends scans
        whatever it sees; of a sensor that reports things nothing comes where none stand, and only the motion's sigma
        grows. is_told: the pose in that map is what somebody says.
        """
        self._silence_is_blind, self._is_told = silence_is_blind, is_told
        self._settings = settings
        self._score = 0.0
        self._lost = self._is_torn = False
        self._square = CONSISTENT
        self._known = self._found = 0.0
        self._scans = self._trusted_scans = scans
        self._blind_scans = 0
        self._supported_ns: int | None = None
        self._blind_rolling_s = 0.0
        self._scanned_ns: int | None = None
        self._usual_gap_s = 0.0
        self._evidence = Evidence()
        self._seen_before_share: float | None = None

    @property
    def settled_before(self) -> int:
        """Number of the scan before which a landmark must have been made to count."""
        return self._trusted_scans - SETTLED_SCANS

    @property
    def is_broken(self) -> bool:
        """Whether its sums are numbers no more: it would believe any pose."""
        return not math.isfinite(self._score + self._square + self._known + self._found)

    def sound(self) -> "QualityMonitor":
        """Itself, or a new one where it is broken."""
        if not self.is_broken:
            return self
        blind, told = self._silence_is_blind, self._is_told
        return QualityMonitor(self._settings, self._scans, silence_is_blind=blind, is_told=told)

    @property
    def is_told(self) -> bool:
        """Whether nothing but somebody's word has spoken for the pose so far."""
        return self._is_told

    @property
    def scans(self) -> int:
        """How many scans it has judged."""
        return self._scans

    @property
    def is_doubted(self) -> bool:
        """Whether the pose may be wrong: from half of the score on at which it is lost."""
        return self.map_is_kept or self._score >= 0.5 * self._settings.lost_score

    def restart(self, stamp_ns: int) -> None:
        """The pose was recognised: doubts about the one before are none about it."""
        self._score, self._lost, self._square = 0.0, False, CONSISTENT
        self._is_torn = self._is_told = False
        self._known = self._found = 0.0
        self._trusted_scans = self._scans
        self._support(stamp_ns)

    @property
    def score(self) -> float:
        """Log-odds against the pose, added up; lost from [slam.quality] lost_score on, until it is back at 0."""
        return self._score

    @property
    def figures(self) -> dict[str, float]:
        """What the judgement rests on, for the record; seen_before_share is -1 where nothing could be compared."""
        evidence = self._evidence
        return {
            "known_in_view": float(evidence.known),
            "known_found": float(evidence.found),
            "known_missed": float(evidence.missed),
            "known_against": evidence.against,
            "known_square": evidence.square,
            "doubt_score": self._score,
            "seen_before_share": -1.0 if self._seen_before_share is None else self._seen_before_share,
        }

    @property
    def map_is_kept(self) -> bool:
        """Whether the map must be left as it is: what is seen now does not belong to it.

        Scans are counted, not seconds: a recording with scans three seconds apart is slow and not lost.
        """
        return self._lost or self._blind_scans >= LOST_BLIND_SCANS

    def doubts(self, evidence: Evidence) -> bool:
        """Whether something speaks against the pose, with what one more scan says."""
        return self._score + evidence.against > 0.0

    def add(
        self,
        stamp_ns: int,
        evidence: Evidence,
        seen_before_share: float | None = None,
        *,
        lies_on_map: bool = False,
        rolling_s: float = math.inf,
    ) -> None:
        """What one scan said.

        seen_before_share: of the beams that could be compared with earlier scans, how many saw the same; None where
        none could. lies_on_map: as a whole it lies on the map where the pose says, and then what is missed is wrong in
        the map. rolling_s: for how long the wheels turned since the scan before; inf: unknown.
        """
        settings = self._settings
        since_s = 0.0 if self._scanned_ns is None else (stamp_ns - self._scanned_ns) * 1e-9
        self._blind_rolling_s += min(rolling_s, since_s)
        self._scans += 1
        self._follow_gaps(stamp_ns)
        self._evidence, self._seen_before_share = evidence, seen_before_share
        if evidence.known == 0 and not self._lost:
            self._score *= 1.0 - FADING
        score = self._score + (min(evidence.against, 0.0) + LIES_ON_MAP if lies_on_map else evidence.against)
        self._score = min(max(score, 0.0), CEILING * settings.lost_score)
        if self._score < 0.1:
            self._score = 0.0
        self._is_told = self._is_told and evidence.against >= SUPPORTS
        bound = (TOLD_SHARE if self._is_told else 1.0) * settings.lost_score
        self._lost = self._score >= bound or (self._lost and self._score > 0.0)
        self._is_torn = self._is_torn and self._lost
        if evidence.found > 0:
            self._square += SMOOTHING * (evidence.square - self._square)
        if evidence.known > 0:
            self._known += QUICKLY * (evidence.known - self._known)
            self._found += QUICKLY * (evidence.found - self._found)
        if seen_before_share is None:
            supported = evidence.known == 0 or self._found >= FOUND_SHARE * self._known
        else:
            supported = seen_before_share >= SEEN_BEFORE_SHARE
        if supported or lies_on_map or evidence.against < SUPPORTS:
            self._support(stamp_ns)
            if self._score == 0.0:
                self._trusted_scans = self._scans
        else:
            if not self._silence_is_blind and self._blind_scans == 0:
                self._support(stamp_ns)
            self._blind_scans += 1

    def tear(self) -> None:
        """The latest scan fits nowhere near where the one before was taken: no motion leads on from there."""
        self._score, self._lost, self._is_torn = CEILING * self._settings.lost_score, True, True

    def _support(self, stamp_ns: int) -> None:
        self._supported_ns, self._blind_rolling_s, self._blind_scans = stamp_ns, 0.0, 0

    def _follow_gaps(self, stamp_ns: int) -> None:
        if self._scanned_ns is not None:
            gap_s = (stamp_ns - self._scanned_ns) * 1e-9
            if self._usual_gap_s == 0.0:
                self._usual_gap_s = gap_s
            else:
                self._usual_gap_s *= GAP_STEP if gap_s > self._usual_gap_s else 1.0 / GAP_STEP
        self._scanned_ns = stamp_ns

    def judge(self, stamp_ns: int, covariance: FloatArray, gap_m: float, rolling_s: float = math.inf) -> Judgement:
        """At stamp_ns, with the covariance (3, 3) and the distance between particles and joint Gaussian. rolling_s: for
        how long the wheels turned since the last scan: a rover that stands is where it was, whatever it sees.
        """
        settings, evidence = self._settings, self._evidence
        if self._supported_ns is None:
            self._supported_ns = stamp_ns
        if not np.isfinite(covariance).all():
            return Judgement(Quality.LOST, "the covariance is not finite")
        blind_s, deviation_m, gap_s = self._blind_s(stamp_ns), largest_deviation_m(covariance), self._usual_gap_s
        against = f"landmarks are not where they should be: found {evidence.found}, missed {evidence.missed}"
        blind = f"nothing on the map is seen: for {blind_s:.1f} s"
        wide = f"the position is not known well enough: sigma {deviation_m:.1f} m"
        if self._is_torn:
            return Judgement(Quality.LOST, "the rover is not where it was: a scan fits nowhere near the one before")
        if self._lost:
            return Judgement(Quality.LOST, against)
        if self._blind_rolling(stamp_ns, rolling_s) > max(settings.lost_blind_s, LOST_GAPS * gap_s):
            return Judgement(Quality.LOST, blind)
        if deviation_m > LOST_M:
            return Judgement(Quality.LOST, wide)
        if self._score >= 0.5 * settings.lost_score:
            return Judgement(Quality.UNCERTAIN, against)
        if self._scans == 0:
            return Judgement(Quality.UNCERTAIN, "no scan has arrived yet")
        if blind_s > max(settings.uncertain_blind_s, UNCERTAIN_GAPS * gap_s):
            return Judgement(Quality.UNCERTAIN, blind)
        if deviation_m > UNCERTAIN_M:
            return Judgement(Quality.UNCERTAIN, wide)
        if gap_m > UNCERTAIN_GAP_M + 3.0 * deviation_m:
            return Judgement(Quality.UNCERTAIN, f"particles and joint Gaussian disagree: by {gap_m:.1f} m")
        if self._square > UNCERTAIN_SQUARE:
            return Judgement(
                Quality.UNCERTAIN, f"landmarks are farther off than their noise allows: square {self._square:.1f}"
            )
        return Judgement(Quality.TRACKING)

    def published(self, quality: Quality, covariance: FloatArray) -> FloatArray:
        """The covariance (3, 3) that goes out: grown while lost, because the filter's own knows nothing of it."""
        if quality is not Quality.LOST:
            return covariance
        grown: FloatArray = covariance + LOST_GROWTH
        return grown

    def state_bytes(self) -> bytes:
        """What the next judgement depends on, for a hash."""
        supported = -1 if self._supported_ns is None else self._supported_ns
        scanned = -1 if self._scanned_ns is None else self._scanned_ns
        sums = (self._score, self._square, self._known, self._found, self._usual_gap_s, self._blind_rolling_s)
        counts = (self._scans, self._trusted_scans, self._blind_scans, supported, scanned)
        return struct.pack("<6d???5q", *sums, self._lost, self._is_torn, self._is_told, *counts)

    def _blind_rolling(self, stamp_ns: int, rolling_s: float) -> float:
        """How much of the time since the last support the rover moved, or may have."""
        since_ns = self._supported_ns if self._scanned_ns is None else self._scanned_ns
        if since_ns is None or not self._silence_is_blind:
            return self._blind_rolling_s
        return self._blind_rolling_s + min(rolling_s, (stamp_ns - since_ns) * 1e-9)

    def _blind_s(self, stamp_ns: int) -> float:
        until_ns = stamp_ns if self._silence_is_blind else self._scanned_ns
        return 0.0 if self._supported_ns is None or until_ns is None else (until_ns - self._supported_ns) * 1e-9


def largest_deviation_m(covariance: FloatArray) -> float:
    """Standard deviation of the position along the larger axis of its ellipse; covariance (3, 3)."""
    difference, cross = covariance[0, 0] - covariance[1, 1], covariance[0, 1]
    largest = 0.5 * (covariance[0, 0] + covariance[1, 1] + math.hypot(difference, 2.0 * cross))
    return math.sqrt(max(largest, 0.0))
