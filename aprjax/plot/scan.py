"""One scan: the surfaces it met, and what of them is too small to count."""

import jax
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from aprjax.anchors.segment import SegmentConfig, segment
from aprjax.numerics import single_precision
from aprjax.plot.style import (
    CLUTTER,
    SURFACE,
    add_legend,
    draw_laser,
    draw_points,
    frame,
    new_axes,
    prepare,
)
from aprjax.scan import Scan

_segment = jax.jit(segment)


@single_precision()
def draw_scan(
    scan: Scan, config: SegmentConfig | None = None, *, ax: Axes | None = None
) -> list[Artist]:
    """Draw one scan in its laser's frame.

    `config` defaults to the segmentation that anchors come from by default: what it finds too
    small is drawn in a light colour, and left out of the picture where it lies outside all else.
    """
    segments = _segment(scan, config or SegmentConfig())
    xy, hit, large = (np.asarray(a) for a in (segments.xy, segments.hit, segments.large))
    around = np.concatenate([np.zeros((1, 2)), xy[large]])
    ax = new_axes(around, 6.0) if ax is None else ax
    prepare(ax)
    drawn = draw_points(ax, xy[large], SURFACE, "large parts")
    if (hit & ~large).any():
        drawn += draw_points(ax, xy[hit & ~large], CLUTTER, "small objects, removed", size=9)
    drawn += draw_laser(ax, np.zeros(3), label="laser")
    frame(ax, around)
    add_legend(ax)
    return drawn
