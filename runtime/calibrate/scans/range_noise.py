"""Noise of one range, from scans taken at standstill: nothing else tells it apart from what the world does."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri  # scipy.stats has it too, and takes 23 MB and a second to import

from drivers.measurements import FloatArray, WheelCounts
from runtime.calibrate.drive_data import DriveData

FEWEST_SCANS = 8  # of one standstill: fewer tell little of a variance
MARGIN_S = 0.3  # a rover that has just stopped still rocks, and the laser's stamps may be late
STILL_COUNTS = 1.0  # an encoder on an edge toggles by one
STILL_MPS = 0.01
RETURN_SHARE = 0.9  # a beam that often comes back empty sees an edge or leaves
OUTLIER = 5.0  # a beam with one such residual saw something move
TRIM = 0.999
LEFTOVER = 0.008  # of sigma: what beams on edges add that the tests let through, measured in the simulated park
LEAST_VARIANCE_M2 = 1e-8  # a laser whose coarse steps hide its noise tells nothing of it
ROUNDS = 6


@dataclass(frozen=True, slots=True)
class RangeNoise:
    """sigma_m and its 95 % interval; None where nothing tells it. still_scans: scans taken at rest."""

    sigma_m: float | None
    low_m: float
    high_m: float
    still_scans: int


def range_noise(drives: Sequence[DriveData]) -> RangeNoise:
    """Pool the variances of the beams that saw something at rest; beams on leaves, edges and people fall out."""
    variances: list[FloatArray] = []
    freedoms: list[FloatArray] = []
    scans = 0
    for drive in drives:
        for begin, end in standstills(drive):
            ranges = [drive.scans[number].ranges_m.astype(np.float64) for number in range(begin, end)]
            if end - begin < FEWEST_SCANS or len({len(row) for row in ranges}) != 1:
                continue
            scans += end - begin
            found, freedom = _beam_variances(np.array(ranges), drive.scans[begin].range_max_m)
            variances.append(found)
            freedoms.append(freedom)
    if not variances or sum(map(len, variances)) < 10:
        return RangeNoise(None, 0.0, 0.0, scans)
    return _pooled(np.concatenate(variances), np.concatenate(freedoms), scans)


def standstills(drive: DriveData) -> Iterator[tuple[int, int]]:
    """First and one past the last scan of every stretch in which the wheels did not turn."""
    series, stamps = drive.wheel_series(), drive.scan_times_s()
    places = np.stack([np.interp(stamps, series.times_s, column) for column in series.values.T], axis=-1)
    counted = isinstance(drive.wheels[0], WheelCounts)
    begin = -1
    for number, stamp in enumerate(stamps):
        first, last = np.searchsorted(series.times_s, (stamp - MARGIN_S, stamp + MARGIN_S))
        window = series.values[max(first - 1, 0) : last + 1]
        if counted:
            still = len(window) > 1 and bool((np.ptp(window, axis=0) <= STILL_COUNTS).all())
        else:
            still = len(window) > 1 and bool((np.abs(window[:, 0]) <= STILL_MPS).all())
        stayed = not counted or bool((np.abs(places[number] - places[begin]) <= STILL_COUNTS).all())
        if begin >= 0 and not (still and stayed):
            yield begin, number
            begin = -1
        if still and begin < 0:
            begin = number
    if begin >= 0:
        yield begin, len(stamps)


def _beam_variances(ranges: FloatArray, range_max_m: float) -> tuple[FloatArray, FloatArray]:
    """Variance of each usable beam over the scans, and its degrees of freedom."""
    with np.errstate(invalid="ignore"):
        ranges = np.where((ranges > 0.0) & (ranges < range_max_m), ranges, np.nan)
    returns = np.isfinite(ranges).sum(axis=0)
    usable = ranges[:, returns >= RETURN_SHARE * len(ranges)]
    if usable.shape[1] == 0:
        return np.zeros(0), np.zeros(0)
    residuals = usable - np.nanmedian(usable, axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(residuals), axis=0)
    typical = max(float(np.median(spread)), 1e-6)
    calm = np.nanmax(np.abs(residuals), axis=0) < OUTLIER * typical
    kept = usable[:, calm]
    if kept.shape[1] == 0:
        return np.zeros(0), np.zeros(0)
    return np.nanvar(kept, axis=0, ddof=1), np.isfinite(kept).sum(axis=0) - 1.0


def _pooled(variances: FloatArray, freedoms: FloatArray, scans: int) -> RangeNoise:
    """Weighted mean of the beams that chi-squared allows; its error from how much the beams differ."""
    pooled = float(np.median(variances))
    if pooled <= LEAST_VARIANCE_M2:
        return RangeNoise(None, 0.0, 0.0, scans)
    kept = np.ones(len(variances), dtype=np.bool_)
    for _ in range(ROUNDS):
        kept = variances * freedoms / pooled < chdtri(freedoms, 1.0 - TRIM)
        pooled = float((variances * freedoms)[kept].sum() / freedoms[kept].sum())
    weights = freedoms[kept] / freedoms[kept].sum()
    deviation = float(np.sqrt((weights**2 * (variances[kept] - pooled) ** 2).sum()))
    sigma = pooled**0.5
    half = 1.96 * float(np.hypot(deviation / (2.0 * sigma), LEFTOVER * sigma))
    return RangeNoise(sigma, sigma - half, sigma + half, scans)
