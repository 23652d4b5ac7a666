"""Vectors that tell views apart: one function for scans, one for images.

Plain functions of one view. A classifier takes any function to a vector of fixed length whose
components are about as large as each other where they differ between places.
"""

import numpy as np

from aprjax.scan import Scan

FARTHEST = 10.0
"""Metres at which ranges are cut: beyond, a scan tells less of the place than of its openings."""


def scan_features(scan: Scan) -> np.ndarray:
    """Size, raggedness and roundness `(3,)` of what a scan sees, however it is turned.

    The root mean square of the ranges in metres (the root of the area); their total variation on
    a logarithmic scale, a tenth of it; and twice the ratio of squared mean to mean square, which
    is least where the scan sees far one way and near the others. Beams of which nothing is known
    are interpolated; a scan without any that tell counts as free to `FARTHEST`.
    """
    beams = int(scan.beams)
    ranges = np.where(scan.no_return, FARTHEST, np.asarray(scan.ranges, float))[:beams]
    known = np.asarray(scan.hit | scan.no_return)[:beams]
    if not known.any():
        return np.array([FARTHEST, 0.0, 2.0])
    beam = np.arange(beams)
    ranges = np.clip(np.interp(beam, beam[known], ranges[known]), 0.05, FARTHEST)
    square = np.mean(ranges**2)
    variation = np.abs(np.diff(np.log(ranges))).sum()
    return np.array([np.sqrt(square), variation / 10, 2 * ranges.mean() ** 2 / square])
