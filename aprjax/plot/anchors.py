"""The paper's Fig. 1: a scan with its anchor points, and their fully connected graph."""

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aprjax.anchors.extract import Anchors
from aprjax.anchors.segment import SegmentConfig, segment
from aprjax.plot.style import (
    CLUTTER,
    SURFACE,
    add_legend,
    draw_anchors_by_kind,
    draw_laser,
    draw_points,
    figure_of,
    frame,
    prepare,
)
from aprjax.relations.graph import AnchorGraph, anchor_graph
from aprjax.scan import Scan

_segment = jax.jit(segment)


def draw_anchors(
    scan: Scan,
    anchors: Anchors,
    graph: AnchorGraph | None = None,
    ax: tuple[Axes, Axes] | None = None,
    config: SegmentConfig | None = None,
) -> Figure:
    """Draw one scan with its anchors to the left and the anchor graph to the right.

    `graph` defaults to the complete graph over `anchors`, `ax` to the two axes of a new figure,
    `config` to the segmentation that the anchors come from by default: what it finds too small
    is drawn in a light colour, and left out of the picture where it lies outside all else. Returns
    the figure, which belongs to no window and can be saved.
    """
    if ax is None:
        figure = Figure(figsize=(11, 5), layout="constrained")
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    else:
        left, right = ax
    _draw_scan(left, scan, anchors, config or SegmentConfig())
    _draw_graph(right, anchors, anchor_graph(anchors) if graph is None else graph)
    return figure_of(left)


def _draw_scan(ax: Axes, scan: Scan, anchors: Anchors, config: SegmentConfig) -> None:
    segments = _segment(scan, config)
    xy, hit, large = (np.asarray(a) for a in (segments.xy, segments.hit, segments.large))
    prepare(ax)
    draw_points(ax, xy[large], SURFACE, "large parts")
    if (hit & ~large).any():
        draw_points(ax, xy[hit & ~large], CLUTTER, "small objects, removed", size=9)
    draw_anchors_by_kind(ax, anchors, np.asarray(anchors.xy))
    draw_laser(ax, np.zeros(3), label="laser")
    ax.set_title(f"Scan with {int(np.sum(anchors.valid))} anchor points", fontsize=10)
    add_legend(ax)
    shown = np.asarray(anchors.xy)[np.asarray(anchors.valid)]
    frame(ax, np.zeros((1, 2)), xy[large], shown)


def _draw_graph(ax: Axes, anchors: Anchors, graph: AnchorGraph) -> None:
    xy, valid = np.asarray(graph.xy), np.asarray(graph.valid)
    a, b = np.nonzero(np.triu(valid))
    prepare(ax)
    ax.add_collection(
        LineCollection(list(np.stack([xy[a], xy[b]], axis=1)), colors="#8a8a8a", linewidths=0.6)
    )
    draw_anchors_by_kind(ax, anchors, xy)
    draw_laser(ax, np.zeros(3))
    ax.set_title(f"Anchor point graph with {int(graph.edges)} edges", fontsize=10)
