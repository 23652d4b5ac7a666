"""The paper's Fig. 1: the anchor points of a scan, and their fully connected graph."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from aprjax.anchors.extract import Anchors
from aprjax.plot.style import (
    add_legend,
    draw_anchors_by_kind,
    draw_laser,
    frame,
    new_axes,
    prepare,
)
from aprjax.relations.graph import AnchorGraph

_EDGE = "#8a8a8a"


def draw_anchors(
    anchors: Anchors, graph: AnchorGraph | None = None, *, ax: Axes | None = None
) -> list[Artist]:
    """Draw the anchors of one scan in its laser's frame, and the edges of their `graph` if given.

    On axes that show the scan already (`aprjax.plot.scan.draw_scan`), they are laid over it.
    """
    xy = np.asarray(anchors.xy)
    count = int(np.sum(anchors.valid))
    around = np.concatenate([np.zeros((1, 2)), xy[np.asarray(anchors.valid)]])
    ax = new_axes(around, 6.0) if ax is None else ax
    first = not ax.has_data()
    prepare(ax)
    drawn: list[Artist] = []
    title = f"{count} anchor points"
    if graph is not None:
        a, b = np.nonzero(np.triu(np.asarray(graph.valid)))
        lines = np.stack([np.asarray(graph.xy)[a], np.asarray(graph.xy)[b]], axis=1)
        edges = LineCollection(list(lines), colors=_EDGE, linewidths=0.6)
        drawn.append(ax.add_collection(edges))
        title = f"{title}, {int(graph.edges)} edges"
    drawn += draw_anchors_by_kind(ax, anchors, xy)
    ax.set_title(title, fontsize=10)
    if first:
        drawn += draw_laser(ax, np.zeros(3), label="laser")
        frame(ax, around)
    add_legend(ax)
    return drawn
