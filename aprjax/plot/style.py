"""What pictures share: colours, markers, axes.

A function of `aprjax.plot` that draws takes what it shows and `ax`, the matplotlib axes to draw on.
Without `ax` it draws on those of a new figure of a fitting size. It returns the artists it added,
in the order drawn, to be restyled or removed; `figure_of` is the figure they are in. Nothing goes
through pyplot: no figure belongs to a window, and no state is shared.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
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
FLOOR, REFERENCE = "#c9c4ba", "#1f5fa8"


def new_axes(xy: np.ndarray, width: float = 10.0) -> Axes:
    """Axes of a new figure that show points `(points, 2)` in metres `width` inches wide."""
    across, up = np.ptp(xy, axis=0) if len(xy) else (1.0, 1.0)
    height = float(np.clip(width * (up + 1.0) / (across + 1.0), 2.0, 1.2 * width))
    return Figure(figsize=(width + 0.8, height + 1.2), layout="constrained").add_subplot()


def figure_of(drawn: Sequence[Artist]) -> Figure:
    """The figure that artists are in, to be saved. Raises `ValueError` where there is none."""
    figure = drawn[0].get_figure(root=True) if drawn else None
    if figure is None:
        raise ValueError("drawn: there are no artists, or they are in no figure")
    return figure


def prepare(ax: Axes) -> None:
    """Axes in metres with one scale for both."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x / m")
    ax.set_ylabel("y / m")
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.set_axisbelow(True)


def frame(ax: Axes, *points: np.ndarray, margin: float = 0.5) -> None:
    """Show what lies around these points `(points, 2)`, `margin` metres more to each side."""
    xy = np.concatenate(points)
    low, high = xy.min(axis=0) - margin, xy.max(axis=0) + margin
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])


def add_legend(ax: Axes) -> None:
    """A legend below the axes and their label, where it hides nothing."""
    below = offset_copy(ax.transAxes, figure_of([ax]), y=-32, units="points")
    place = {"bbox_to_anchor": (0.5, 0), "bbox_transform": below}
    ax.legend(fontsize=8, loc="upper center", ncols=3, frameon=False, **place)


def draw_points(
    ax: Axes, xy: np.ndarray, colour: str, label: str, size: float = 6.0
) -> list[Artist]:
    """Scan points `(points, 2)` in metres."""
    return [ax.scatter(xy[:, 0], xy[:, 1], s=size, c=colour, linewidths=0, label=label, zorder=2)]


def draw_laser(
    ax: Axes, pose: np.ndarray, colour: str = LASER, label: str | None = None
) -> list[Artist]:
    """The place `(3,)` of a laser, in metres and radians, as a triangle that points forward."""
    shape = Path([(-0.7, -0.6), (1.0, 0.0), (-0.7, 0.6), (-0.7, -0.6)], closed=True)
    marker = MarkerStyle(shape).rotated(rad=float(pose[2]))
    return [
        *ax.plot(
            pose[0],
            pose[1],
            marker=marker,
            markersize=11,
            color=colour,
            ls="",
            label=label,
            zorder=5,
        )
    ]


def draw_poses(
    ax: Axes, poses: np.ndarray, colour: str, label: str, *, tick: float, size: float, zorder: int
) -> list[Artist]:
    """Poses `(poses, 3)` in metres and radians as points with a `tick` in metres ahead."""
    heading = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=-1)
    ticks = np.stack([poses[:, :2], poses[:, :2] + tick * heading], axis=1)
    lines = LineCollection(list(ticks), colors=colour, linewidths=1.2, zorder=zorder)
    points = ax.scatter(
        *poses[:, :2].T,
        s=size,
        c=colour,
        edgecolors="white",
        linewidths=0.4,
        label=f"{label} ({len(poses)})",
        zorder=zorder,
    )
    return [ax.add_collection(lines), points]


def draw_anchors_by_kind(
    ax: Axes, anchors: Anchors, xy: np.ndarray, *, filled: bool = True
) -> list[Artist]:
    """Anchors, each kind with its marker and named once, at `xy` `(anchors, 2)` in metres."""
    valid, kinds = np.asarray(anchors.valid), np.asarray(anchors.kind)
    named = ax.get_legend_handles_labels()[1]
    drawn: list[Artist] = []
    for kind, (name, marker, colour) in KINDS.items():
        shown = xy[valid & (kinds == kind)]
        points = ax.scatter(
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
        drawn.append(points)
    return drawn
