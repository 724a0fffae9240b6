"""The only door into slam: scans and wheel samples in, the pose with its covariance out."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import chain

import numpy as np

from drivers.measurements import IntArray, Scan, ScanLike, WheelSample
from slam.estimate import AHEAD_NS, Estimate
from slam.front_end.alignment import Alignment
from slam.front_end.deskew import Twist, with_motion_noise
from slam.front_end.front_ends import make_front_end
from slam.joint.evidence import Confidence
from slam.joint.gaussian import JointGaussian
from slam.maps.joint_map import JointMap
from slam.maps.start import MapStart, first_maps
from slam.maps.views import NO_VIEWS
from slam.observations import NO_FEATURES, match_figures, seen_before_share, usable_rows, verdicts_of_all
from slam.odometry.odometry import Increment, Odometry, compound
from slam.odometry.scan_clock import ScanClock
from slam.particles.fastslam import FastSlam, ScanOutcome
from slam.quality import QualityMonitor
from slam.recognise.local_points import around
from slam.recognise.prior import PosePrior
from slam.relocalise.breakdown import Breakdown, BrokenFilterError, broken
from slam.relocalise.local_map import ScanSeen, ScanTaken, no_witness
from slam.relocalise.relocaliser import Relocaliser
from slam.scan_search.stretch import NO_POINTS
from slam.settings.slam import SlamSettings
from slam.visibility import BLIND, SensorView
from slam.warm_up import TICK_NS, warm_up_drive, warm_up_gap, warm_up_rare, warm_up_settings

MAP_EVERY = 10  # scans: once a second, as often as the map is published


def no_mark(stage: str) -> None:
    """Nobody wants to know how long the stages take."""


class Estimator:
    """Landmark estimation and Unscented FastSLAM with a joint Gaussian beside it, whose pose is published.

    Deterministic: the same settings, seed and inputs give the same bits. Stamps are the only time it knows.
    """

    def __init__(
        self,
        settings: SlamSettings,
        seed: int,
        mark: Callable[[str], None] = no_mark,
        map_every: int = MAP_EVERY,
        start: MapStart | None = None,
        witness: Callable[[ScanTaken], None] = no_witness,
    ) -> None:
        """mark: told the name of each stage of a step as it ends, for someone who has a clock. map_every: the map goes
        with every so many-th estimate. start: the saved map that the drive begins in, else its map begins where it is.
        witness: told of every scan what the joint Gaussian made of it.
        """
        self._settings, self._body_from_laser = settings, settings.mount.as_pose()
        self._mark, self._witness, self._map_every = mark, witness, map_every
        self._generator = np.random.default_rng(seed)
        self._odometry = Odometry(settings.odometry)
        self._particles = FastSlam(settings, self._generator)
        self._start, self._hash = start, bytes(16) if start is None else start.digest()
        self._begin_seeing()
        self._joint, saved = first_maps(settings, start)
        if saved is self._joint:
            self._redraw_particles()
        self._relocaliser = Relocaliser(settings, self._joint, saved, NO_VIEWS if start is None else start.known.views)
        self._keyframes = self._relocaliser.here.keyframes
        told, reports = saved is self._joint, settings.front_end.kind == "given"
        self._quality = QualityMonitor(settings.quality, self._joint.scans, silence_is_blind=not reports, is_told=told)
        self._scan_clock, self._breakdown, self._stands = ScanClock(), Breakdown(), False

    def step(
        self,
        stamp_ns: int,
        scan: ScanLike | None,
        wheels: tuple[WheelSample, ...],
        told: PosePrior | None = None,
    ) -> Estimate:
        """The estimate at stamp_ns from everything up to then; without a scan a prediction from the wheels.

        told: where somebody says that the rover is. It is looked for there with the next scans; what comes of it is
        a recognition, or a refusal.
        """
        if self._scan_clock.follow(stamp_ns):
            self._odometry.begin_anew()
        self._odometry.add(wheels, stamp_ns + AHEAD_NS)
        if told is not None:
            self._relocaliser.tell(told.moved(self._odometry.predicted(stamp_ns).as_pose().inverse()))
        if scan is None or not self._scan_clock.is_new(scan.stamp_ns, stamp_ns):
            return self._prediction(stamp_ns)
        increment = self._odometry.take_until(scan.stamp_ns)
        scan = self._settings.mount.upright(scan)
        if self._scan_clock.last_ns is None:
            increment = replace(increment, covariance=np.zeros((3, 3)))  # the map begins here, wherever that is
        self._scan_clock.last_ns, moved = scan.stamp_ns, (self._particles.scans, self._joint.moves)
        try:
            return self._scan_step(stamp_ns, scan, increment)
        except Exception as error:
            if cause := self._begin_anew_where_broken(stamp_ns):
                raise BrokenFilterError(cause) from error
            self._keep_motion(increment, *moved)
            raise

    def state_hash(self) -> bytes:
        """16 bytes over everything that the next step depends on; two runs agree in it only if they agree in all."""
        return self._hash

    def joint_map(self) -> JointMap:
        """The map as it is now, for a later drive to begin in."""
        return self._relocaliser.lasting.taken()

    @classmethod
    def warm_up(cls, settings: SlamSettings | None = None) -> None:
        """Compile every kernel, or load it from the cache, so that the first tick is as quick as the others."""
        for front_end in ("given", "robust"):
            short = warm_up_settings(settings or SlamSettings(), front_end)
            estimator = cls(short, 0)
            for stamp_ns, scan, wheels in chain(warm_up_drive(short), warm_up_gap(short)):
                estimator.step(stamp_ns, scan, wheels)
            estimator._redraw_particles()
            estimator.step(stamp_ns + TICK_NS, None, ())
        warm_up_rare(JointGaussian(short.joint, short.mount.as_pose(), short.tuning()))

    def _scan_step(self, stamp_ns: int, scan: ScanLike, by_wheels: Increment) -> Estimate:
        """The step of the paper, one stage after the other."""
        measured = increment = self._alignment.refine(scan, by_wheels, self._keyframes.know)
        before = self._joint.map_from_body
        self._joint.predict(increment.mean, increment.covariance)
        laid = self._alignment.laid
        if laid is not None and self._keyframes.constrain(laid) and not self._alignment.is_due:
            increment = replace(increment, mean=(before.inverse() @ self._joint.map_from_body).as_array())
        twist = Twist(increment.speed_mps, increment.lateral_mps, increment.yaw_rate_radps)
        predicted = self._relocaliser.continuous(before @ increment.as_pose())
        self._mark("odometry")

        # difference and features (III-A)
        self._stands = increment.at_rest
        waits = self._stands and not self._relocaliser.awaits_saved  # until what moves has gone
        features, verdicts = self._front_end.observe(scan, predicted, twist, waits)
        self._mark("front end")
        features = with_motion_noise(features, scan, increment.covariance, increment.duration_s)
        rows = usable_rows(features, self._settings.view.range_max_m, self._body_from_laser.heading_rad)
        seen_share = seen_before_share(verdicts)
        blind = isinstance(scan, Scan) and seen_share is None  # nothing came back: that says nothing of what is gone
        sight = BLIND if blind else self._view.of(scan, rows)

        # associate, sample, update, resample and prune in every particle (III-B)
        outcome = self._particles.step(increment, rows, sight)
        self._mark("particles")

        # the joint Gaussian, whose pose is published, and whether it can be believed
        confidence = Confidence(self._quality.settled_before, self._quality.map_is_kept)
        matched = self._joint.observe(rows, outcome.matches, sight, confidence, alone_m=self._alignment.alone_m)
        evidence, quality = self._joint.evidence, self._quality
        if not quality.is_doubted:
            self._view.learn(evidence.found, evidence.missed)
            if laid is not None:
                self._keyframes.keep(laid)
        lies = laid is not None and quality.doubts(evidence) and self._keyframes.lies_on(laid, quality.settled_before)
        quality.add(scan.stamp_ns, evidence, seen_share, lies_on_map=lies, rolling_s=by_wheels.rolling_s)
        if self._alignment.is_torn and evidence.against >= 0.0:
            quality.tear()
        self._mark("joint")

        # the way back, where the pose is in doubt or a place may be known
        points = NO_POINTS if laid is None else self._keyframes.thinned(laid).astype(np.float32)
        seen = ScanSeen(scan.stamp_ns, increment.mean, increment.covariance, rows, sight, seen_share, points, laid)
        keyframes, progress = self._keyframes, self._relocaliser.here.progress
        recognition = self._relocaliser.step(seen, matched, self._quality)
        told = (seen, measured, self._odometry.odom_from_body, matched, keyframes.take_fits(), progress)
        if recognition is not None:
            self._go_on_here()
        here, joint = self._relocaliser.here, self._joint
        self._witness(ScanTaken(*told, here.progress, joint.map_from_body, joint.covariance))
        self._mark("relocalise")
        if cause := broken(self._joint, self._particles, self._quality):
            raise BrokenFilterError(cause)

        matches = verdicts_of_all(rows, outcome.matches, len(features))
        self._chain_hash(matches)
        prediction = self._prediction(stamp_ns)
        due = self._particles.scans % self._map_every == 0 and not self._relocaliser.awaits_saved
        return replace(
            prediction,
            particles=self._particles.weighted_poses,
            particle_weights=self._particles.weights,
            features=features,
            matches=matches,
            beam_verdicts=verdicts,
            landmarks=self._joint.landmarks() if due else None,
            counts=prediction.counts
            | self._scan_counts(increment, matches, outcome)
            | self._quality.figures
            | ({} if recognition is None else recognition.figures),
            recognition=recognition or prediction.recognition,
            refusal=self._relocaliser.take_refusal(),
        )

    def _go_on_here(self) -> None:
        """In the map, or at the place in it, that was recognised; the particles are drawn anew there."""
        self._joint, self._keyframes = self._relocaliser.here.joint, self._relocaliser.here.keyframes
        self._redraw_particles()

    def _redraw_particles(self) -> None:
        self._particles.redraw(*around(self._joint.state, self._settings.view.range_max_m))

    def _begin_seeing(self) -> None:
        """With no scan before."""
        settings, techniques = self._settings, self._settings.techniques
        used = {"difference": techniques.difference, "sparse": techniques.sparse}
        self._front_end = make_front_end(settings.front_end, **used, body_from_laser=self._body_from_laser)
        self._alignment = Alignment(settings.front_end, self._body_from_laser)
        self._view = SensorView(settings.front_end.range_min_m)

    def _begin_anew_where_broken(self, stamp_ns: int) -> str:
        """What is no number any more in the filter; "" where all are. It goes on from its last pose that was one."""
        cause = broken(self._joint, self._particles, self._quality)
        if cause:
            self._begin_seeing()
            self._quality = self._quality.sound()
            pose = self._breakdown.sound_pose
            begun = self._relocaliser.begin_anew_where_broken(pose, self._quality, stamp_ns, self._start)
            self._go_on_here()
            self._breakdown.note(cause, self._quality.scans, begun)
        return cause

    def _keep_motion(self, increment: Increment, particle_scans: int, joint_moves: int) -> None:
        """A step has failed: its scan is lost, but not the motion that the wheels measured.

        The filters that had not taken it yet, by their counts before, take it with nothing in sight.
        """
        if self._particles.scans == particle_scans:
            self._particles.step(increment, NO_FEATURES, BLIND)
        if self._joint.moves == joint_moves:
            self._joint.predict(increment.mean, increment.covariance)

    def _prediction(self, stamp_ns: int) -> Estimate:
        """The poses at the last scan moved on by the wheels to stamp_ns, their covariances grown by the wheels' own."""
        self._begin_anew_where_broken(stamp_ns)
        particle_mean, particle_covariance = self._particles.mean()
        pose, covariance = self._joint.map_from_body, self._joint.covariance
        self._breakdown.sound_pose = pose
        gap_m = math.hypot(pose.x_m - particle_mean.x_m, pose.y_m - particle_mean.y_m)
        since = self._odometry.predicted(stamp_ns)
        moved = since.as_pose()
        grown = compound(pose, covariance, since)
        judgement = self._relocaliser.judged(self._quality.judge(stamp_ns, grown, gap_m, since.rolling_s))
        judgement = self._breakdown.judged(judgement, self._quality.scans)
        return Estimate(
            stamp_ns=stamp_ns,
            map_from_body=pose @ moved,
            covariance=self._quality.published(judgement.quality, grown),
            particle_mean=particle_mean @ moved,
            particle_covariance=compound(particle_mean, particle_covariance, since),
            odom_from_body=self._odometry.odom_from_body @ moved,
            quality=judgement.quality,
            doubt=judgement.doubt,
            counts=self._counts(),
            recognition=self._breakdown.take_recognition(),
        )

    def _counts(self) -> dict[str, float]:
        """Figures that every tick has."""
        refused = {f"{name}_refused": float(number) for name, number in self._odometry.refused.items() if number}
        return refused | {
            "landmarks": float(self._particles.store.count_of(self._particles.best)),
            **self._scan_clock.counts,
            "not_finite": float(self._breakdown.times),
        }

    def _scan_counts(self, increment: Increment, matches: IntArray, outcome: ScanOutcome) -> dict[str, float]:
        """Figures of a tick with a scan."""
        return {
            **match_figures(matches),
            **outcome.figures,
            "at_rest": float(self._stands),
            "odometry_known": float(increment.known),
            "scans_aligned": float(self._alignment.refined),
            **self._keyframes.figures,
            **self._relocaliser.figures,
        }

    def _chain_hash(self, matches: IntArray) -> None:
        """Fold what this scan changed into the hash: poses, weights, generator, the best map in view, the joint
        Gaussian.
        """
        particles = self._particles
        digest = hashlib.blake2b(self._hash, digest_size=16)
        for array in (particles.poses, particles.log_weights, matches, *particles.map_in_view()):
            digest.update(np.ascontiguousarray(array).data)
        digest.update(repr(self._generator.bit_generator.state).encode())
        for part in (self._joint, self._quality, self._view, self._relocaliser):
            digest.update(part.state_bytes())
        self._hash = digest.digest()
