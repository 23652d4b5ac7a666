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


_QUARTERS, _BINS = 4, 4
_CHROMATICITY = 0.18, 0.48  # shares of red and of green that the histogram spans


def image_features(image: np.ndarray) -> np.ndarray:
    """Colours of an image `(rows, columns, 3)`, red, green and blue, as a vector `(28,)`.

    First a histogram of 4 x 4 bins over the shares of red and green, as square roots: what colours
    there are, wherever. Each pixel is shared among the bins around it, so that a slight change of
    light moves no pixel from one bin to another. Then the mean colours of four parts from left to
    right, of the middle half of the rows: where they are, roughly. Channels are divided by their
    means first (grey world), which takes out brightness and colour of the light. Any scale of the
    values serves. Raises `ValueError` for another shape, fewer than four columns, and a value that
    is negative or not finite.
    """
    pixels = np.asarray(image, float)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.shape[1] < _QUARTERS:
        raise ValueError(f"image: shape {pixels.shape} is not (rows, 4 or more columns, 3)")
    if pixels.shape[0] == 0 or not np.all((pixels >= 0) & np.isfinite(pixels)):
        raise ValueError("image: there are no rows, or a value is negative or not finite")
    means = pixels.mean(axis=(0, 1))
    # A channel without light, as in a black image, counts as grey.
    pixels = np.where(means > 0, pixels / np.where(means > 0, means, 1.0), 1.0)
    rows = len(pixels)
    middle = pixels[rows // 4 : rows - rows // 4]
    parts = np.array_split(middle, _QUARTERS, axis=1)
    return np.concatenate([_chromaticities(pixels), *(p.mean(axis=(0, 1)) for p in parts)])


def _chromaticities(pixels: np.ndarray) -> np.ndarray:
    """The square roots `(16,)` of the shares of pixels in bins of chromaticity."""
    total = pixels.sum(axis=-1, keepdims=True)
    share = np.where(total > 0, pixels / np.where(total > 0, total, 1.0), 1 / 3)[..., :2]
    low, high = _CHROMATICITY
    place = np.clip((share.reshape(-1, 2) - low) / (high - low), 0.0, 1.0) * (_BINS - 1)
    cell = np.minimum(place.astype(int), _BINS - 2)
    part = place - cell
    bins = np.zeros((_BINS, _BINS))
    for red in (0, 1):
        for green in (0, 1):
            weight = np.abs(1 - red - part[:, 0]) * np.abs(1 - green - part[:, 1])
            np.add.at(bins, (cell[:, 0] + red, cell[:, 1] + green), weight)
    return np.sqrt(bins.ravel() / bins.sum())
