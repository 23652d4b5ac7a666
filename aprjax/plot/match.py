"""Two matched scans in one frame, with what the one with the better overview says of the other."""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from aprjax.evaluation.congruence import sees
from aprjax.evaluation.synthetic_scan import synthetic_scan
from aprjax.evaluation.view import View
from aprjax.features import FeatureConfig
from aprjax.numerics import single_precision
from aprjax.plot.style import (
    add_legend,
    draw_anchors_by_kind,
    draw_laser,
    draw_points,
    new_axes,
    prepare,
)
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.se2 import Pose, inverse, transform

_REFERENCE, _QUERY, _SYNTHETIC = "#777777", "#d9480f", "#2b8cbe"


@single_precision()
def draw_match(
    reference_scan: Scan,
    query_scan: Scan,
    T_ref_query: Pose,
    quality: float | None = None,
    config: FeatureConfig | None = None,
    *,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw a query scan over a reference scan, in the reference's frame.

    `T_ref_query` `(3,)` is the pose to show, in metres and radians, and `quality` its e_m for the
    title. Anchors of the reference are hollow, those of the query filled. The synthetic scan is
    that of the scan with the better overview, which contains the other's sensing position; where
    both or neither do, the reference's. `config` says how the scans are described.
    """
    T_ref_query = jnp.asarray(T_ref_query, jnp.float32)
    # As a set of two, so that what was compiled for matching serves here too.
    both = ReferenceSet.build([reference_scan, query_scan], config).index.features
    reference, query = (jax.tree.map(lambda array: array[i], both) for i in (0, 1))  # noqa: B023
    xy_reference = np.asarray(reference.view.xy)[np.asarray(reference.view.hit)]
    xy_query = np.asarray(transform(T_ref_query, query.view.xy))[np.asarray(query.view.hit)]
    ax = new_axes(np.concatenate([xy_reference, xy_query]), 7.2) if ax is None else ax
    prepare(ax)
    drawn = draw_points(ax, xy_reference, _REFERENCE, "reference", size=10)
    synthetic, source = _synthetic(reference.view, query.view, T_ref_query)
    rings = ax.scatter(
        *synthetic.T,
        s=16,
        facecolors="none",
        edgecolors=_SYNTHETIC,
        linewidths=0.7,
        label=f"synthetic, from the {source}",
    )
    drawn.append(rings)
    drawn += draw_points(ax, xy_query, _QUERY, "query", size=6)
    drawn += draw_anchors_by_kind(
        ax, reference.anchors, np.asarray(reference.anchors.xy), filled=False
    )
    moved = np.asarray(transform(T_ref_query, query.anchors.xy))
    drawn += draw_anchors_by_kind(ax, query.anchors, moved)
    drawn += draw_laser(ax, np.zeros(3), _REFERENCE)
    drawn += draw_laser(ax, np.asarray(T_ref_query), _QUERY)
    x, y, theta = np.asarray(T_ref_query)
    place = f"x {x:.2f} m, y {y:.2f} m, θ {np.degrees(theta):.1f}°"
    ax.set_title(place if quality is None else f"e_m {quality:.2f}; {place}", fontsize=10)
    add_legend(ax)
    return drawn


def _synthetic(reference: View, query: View, T_ref_query: Pose) -> tuple[np.ndarray, str]:
    """Points `(points, 2)` of the synthetic scan in the reference's frame, and whose scan it is."""
    T_query_ref = inverse(T_ref_query)
    by_query = bool(sees(query, T_query_ref[:2])) and not bool(sees(reference, T_ref_query[:2]))
    if by_query:
        return _points(synthetic_scan(query, T_ref_query, reference.bearings), reference), "query"
    points = _points(synthetic_scan(reference, T_query_ref, query.bearings), query)
    return np.asarray(transform(T_ref_query, jnp.asarray(points))), "reference"


def _points(inverse_range: jax.Array, front: View) -> np.ndarray:
    """The points of a synthetic scan in the frame of the front scan."""
    real = np.arange(front.xy.shape[0]) < int(front.beams)
    known = real & (np.asarray(inverse_range) > 0)
    ranges, bearings = 1.0 / np.asarray(inverse_range)[known], np.asarray(front.bearings)[known]
    return ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
