"""CARMEN logs as `read_log` reads them back: scans, odometry and stamps."""

import gzip
import os
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.scan import Scan

_NO_RETURN, _INVALID = "81.83", "0"  # SICK's code for above maximum; a reading that says nothing
_LIMITS = 1.0, 81.82  # metres: a header's maximum that is believed


def write_log(
    path: str | os.PathLike[str],
    scans: Scan,
    odometry: np.ndarray,
    stamps: np.ndarray,
    *,
    accuracy: float = 0.01,
) -> None:
    """Write a run as a CARMEN log, gzipped if the name ends in .gz; the same bytes every time.

    `scans` is stacked, `(N, slots)`, of one laser at the robot's centre; `odometry` `(N, 3)` is
    the robot's pose in the odometry's frame, in metres and radians, and `stamps` `(N,)` are
    seconds; `accuracy` in metres stands in the header of the scans and is read by nobody here.
    ROBOTLASER1 lines state the angles and the odometry's pose. An ODOM line with the same pose
    stands before and after each, so that a step from the first after one scan to the last before
    the next is all of it. Speeds are not stated (0).

    `read_log` restates hits, +inf, angles, `range_max` and the number of beams by the bit; poses
    and stamps to six decimals, and odometry from (0, 0, 0) at the first scan. The format knows no
    shortest range and one kind of invalid beam: `range_min` is read as 0.02, and all that is
    neither a hit nor +inf as NaN. A hit within a millimetre of `range_max` is read as +inf, and
    where all readings together show a saturation value (see `saturation_value`), so is that.

    Complete or not there: see `atomic_write`. Raises `ValueError` naming the field, the index and
    the value for arrays that do not fit each other, for what is not finite, and for a `range_max`
    that is not one for all scans or that a reader would not believe; `OSError` for the file.
    """
    _check(scans, odometry, stamps)
    with ExitStack() as stack:
        file = stack.enter_context(atomic_write(path, "wb"))
        if os.fspath(path).endswith(".gz"):
            packed = gzip.GzipFile("", "wb", fileobj=file, mtime=0)
            file = stack.enter_context(packed)
        for line in _lines(scans, odometry, stamps, accuracy):
            file.write(f"{line}\n".encode())


def _check(scans: Scan, odometry: np.ndarray, stamps: np.ndarray) -> None:
    if np.ndim(scans.ranges) != 2:
        raise ValueError(f"scans: ranges of shape {np.shape(scans.ranges)} are not (N, slots)")
    count = len(scans.ranges)
    for name, value, shape in (("odometry", odometry, (count, 3)), ("stamps", stamps, (count,))):
        if np.shape(value) != shape:
            raise ValueError(f"{name}: shape {np.shape(value)} is not {shape}")
        for index in np.argwhere(~np.isfinite(value))[:1]:
            raise ValueError(
                f"{name}{index.tolist()}: {np.asarray(value)[tuple(index)]} is not finite"
            )
    limit = np.asarray(scans.range_max)
    low, high = _LIMITS
    for index in np.flatnonzero((limit != limit[:1]) | (limit < low) | (limit > high))[:1]:
        raise ValueError(
            f"scans.range_max[{index}]: {limit[index]} m is not that of the first scan"
            f"{'' if index else f', or not from {low} to {high}'}"
        )


def _lines(scans: Scan, odometry: np.ndarray, stamps: np.ndarray, accuracy: float) -> Iterator[str]:
    yield "# message, its contents, time, host, time of logging; metres, radians, seconds"
    ranges, hit = np.asarray(scans.ranges, np.float32), np.asarray(scans.hit)
    for i, stamp in enumerate(stamps):
        beams, step = int(scans.beams[i]), scans.angle_increment[i]
        readings = np.where(hit[i], _shortest(ranges[i]), _INVALID)
        readings = np.where(np.isposinf(ranges[i]), _NO_RETURN, readings)[:beams]
        start, turn, step, limit = _shortest(
            [scans.angle_min[i], step * (beams - 1), step, scans.range_max[i]]
        )
        pose = " ".join(f"{value:.6f}" for value in odometry[i])
        end = f"{stamp:.6f} aprjax {stamp:.6f}"
        moved = f"ODOM {pose} 0 0 0 {end}"
        yield moved
        yield (
            f"ROBOTLASER1 0 {start} {turn} {step} {limit} {accuracy} 0 {beams} "
            f"{' '.join(readings)} 0 {pose} {pose} 0 0 0 0 0 {end}"
        )
        yield moved


def _shortest(values) -> np.ndarray:
    """The shortest texts that read back as the same float32."""
    return np.asarray(values, np.float32).astype(str)
