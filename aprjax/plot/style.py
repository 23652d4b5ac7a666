"""What pictures of scans share: colours, markers, axes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import offset_copy

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors

KINDS = {
    Kind.JUMP_EDGE: ("jump edge", "^", "#c1272d"),
    Kind.ANGLE: ("angle", "s", "#1f5fa8"),
    Kind.VIRTUAL_EDGE: ("virtual edge", "D", "#2a8a3e"),
}
"""Name, marker and colour of each kind of anchor."""

SURFACE, CLUTTER, LASER = "#333333", "#e0b070", "#000000"


def prepare(ax: Axes) -> None:
    """Axes in metres with one scale for both."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x / m")
    ax.set_ylabel("y / m")
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.set_axisbelow(True)


def figure_of(ax: Axes) -> Figure:
    """The figure that axes are in."""
    figure = ax.get_figure(root=True)
    if figure is None:
        raise ValueError("ax: the axes are in no figure")
    return figure


def draw_points(ax: Axes, xy: np.ndarray, colour: str, label: str, size: float = 6.0) -> None:
    """Scan points `(points, 2)` in metres."""
    ax.scatter(xy[:, 0], xy[:, 1], s=size, c=colour, linewidths=0, label=label, zorder=2)


def draw_laser(ax: Axes, pose: np.ndarray, colour: str = LASER, label: str | None = None) -> None:
    """The place `(3,)` of a laser, in metres and radians, as a triangle that points forward."""
    shape = Path([(-0.7, -0.6), (1.0, 0.0), (-0.7, 0.6), (-0.7, -0.6)], closed=True)
    marker = MarkerStyle(shape).rotated(rad=float(pose[2]))
    ax.plot(
        pose[0], pose[1], marker=marker, markersize=11, color=colour, ls="", label=label, zorder=5
    )


def frame(ax: Axes, *points: np.ndarray, margin: float = 0.5) -> None:
    """Show what lies around these points `(points, 2)`, `margin` metres more to each side."""
    xy = np.concatenate(points)
    low, high = xy.min(axis=0) - margin, xy.max(axis=0) + margin
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])


def add_legend(ax: Axes) -> None:
    """A legend below the axes and their label, where it hides nothing."""
    below = offset_copy(ax.transAxes, figure_of(ax), y=-32, units="points")
    place = {"bbox_to_anchor": (0.5, 0), "bbox_transform": below}
    ax.legend(fontsize=8, loc="upper center", ncols=3, frameon=False, **place)


def draw_anchors_by_kind(
    ax: Axes, anchors: Anchors, xy: np.ndarray, *, filled: bool = True
) -> None:
    """Anchors, each kind with its marker and named once, at `xy` `(anchors, 2)` in metres."""
    valid, kinds = np.asarray(anchors.valid), np.asarray(anchors.kind)
    named = ax.get_legend_handles_labels()[1]
    for kind, (name, marker, colour) in KINDS.items():
        shown = xy[valid & (kinds == kind)]
        ax.scatter(
            shown[:, 0],
            shown[:, 1],
            s=55 if filled else 95,
            marker=marker,
            facecolors=colour if filled else "none",
            edgecolors="white" if filled else colour,
            linewidths=0.8 if filled else 1.3,
            label=name if len(shown) and name not in named else None,
            zorder=4,
        )
