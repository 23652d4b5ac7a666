"""The paper's Fig. 3: a run over a floor, and where matching said that it went."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection

from aprjax.plot.style import (
    FLOOR,
    REFERENCE,
    add_legend,
    draw_poses,
    frame,
    new_axes,
    prepare,
)
from aprjax.sim.world import World

_CORRECT, _FALSE = "#8a8a8a", "#000000"
_TICK = 0.55  # metres, for a reference's heading
# Metres, forward and left: an estimate's triangle, its tip ahead, on a floor of up to `_SPAN`.
_SPAN = 25.0
_TRIANGLE = np.array([[0.18, 0.0], [-0.1, 0.1], [-0.1, -0.1]])


def draw_map(
    floor: World | np.ndarray,
    T_world_ref: np.ndarray,
    T_world_query: np.ndarray,
    correct: np.ndarray,
    false: np.ndarray,
    *,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw a run's global matches over the floor, in the floor's frame.

    `floor` is a plan, drawn in light lines, or what scans saw of it, `(points, 2)` in metres,
    drawn as light dots; `T_world_ref` `(references, 3)` are the poses of the reference scans,
    points with a tick along the heading; `T_world_query` `(queries, 3)` are the estimates in the
    order of the run, in metres and radians. Those under `correct` are grey
    triangles and those under `false` black ones, masks `(queries,)`; the others are not drawn,
    but a line bridges the gap they leave between two correct ones.
    """
    seen = np.asarray(floor.segments).reshape(-1, 2) if isinstance(floor, World) else floor
    ax = new_axes(seen) if ax is None else ax
    prepare(ax)
    ax.grid(False)
    if isinstance(floor, World):
        drawn = _draw_world(ax, np.asarray(floor.segments), np.asarray(floor.circles))
    else:
        # As pixels and not as vectors: there are tens of thousands.
        drawn: list[Artist] = [
            *ax.plot(*floor.T, ls="", marker=",", color=FLOOR, zorder=1, rasterized=True)
        ]
    drawn += draw_poses(
        ax, T_world_ref, REFERENCE, "reference scans", tick=_TICK, size=26, zorder=6
    )
    found, wrong = T_world_query[np.asarray(correct)], T_world_query[np.asarray(false)]
    size = max(1.0, np.ptp(seen, axis=0).max() / _SPAN) if len(seen) else 1.0
    drawn += _draw_triangles(ax, found, size, _CORRECT, "correct", zorder=3)
    drawn += _draw_triangles(ax, wrong, size, _FALSE, "false", zorder=5)
    drawn += _draw_gaps(ax, T_world_query, np.flatnonzero(correct))
    frame(ax, seen, T_world_ref[:, :2], found[:, :2], wrong[:, :2])
    add_legend(ax)
    return drawn


def _draw_world(ax: Axes, segments: np.ndarray, circles: np.ndarray) -> list[Artist]:
    walls = LineCollection(list(segments), colors=FLOOR, linewidths=0.8, zorder=1)
    x, y, radius = circles[circles[:, 2] > 0].T
    round_things = EllipseCollection(
        2 * radius,
        2 * radius,
        np.zeros(len(radius)),
        units="xy",
        offsets=np.stack([x, y], axis=-1),
        offset_transform=ax.transData,
        facecolors="none",
        edgecolors=FLOOR,
        linewidths=0.6,
        zorder=1,
    )
    return [ax.add_collection(walls), ax.add_collection(round_things)]


def _draw_triangles(
    ax: Axes, poses: np.ndarray, size: float, colour: str, label: str, zorder: int
) -> list[Artist]:
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    ahead, left = size * _TRIANGLE.T
    turned = np.stack([cos * ahead - sin * left, sin * ahead + cos * left], axis=-1)
    triangles = PolyCollection(
        list(poses[:, None, :2] + turned),
        facecolors=colour,
        edgecolors="white",
        linewidths=0.25,
        zorder=zorder,
    )
    # A collection of polygons would be a rectangle in the legend.
    named = ax.plot([], [], ls="", marker=">", color=colour, label=f"{label} ({len(poses)})")
    return [ax.add_collection(triangles), *named]


def _draw_gaps(ax: Axes, poses: np.ndarray, found: np.ndarray) -> list[Artist]:
    """Lines between estimates that follow each other in `found` but not in the run."""
    before = np.flatnonzero(np.diff(found) > 1)
    gaps = np.stack([poses[found[before], :2], poses[found[before + 1], :2]], axis=1)
    lines = LineCollection(list(gaps), colors=_CORRECT, linewidths=0.9, zorder=2)
    lines.set_label("no match between")
    return [ax.add_collection(lines)]
