"""The paper's Figs. 4 and 6: a world model assembled into one frame, with what was seen where."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from aprjax.plot.style import add_legend, figure_of, frame, prepare
from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc
from aprjax.world.plane import compose

_SCANS, _DRIVEN, _CLOSED = "#c9c4ba", "#333333", "#2a8a3e"
_REFERENCE, _TORN = "#1f5fa8", "#c1272d"
_TICK = 0.6  # metres, for a reference's viewing direction
_GAP = 0.05  # metres from which an arc is drawn torn
_FAR = 12.0  # metres up to which the points of a scan are drawn


def draw_world(
    world: WorldModel,
    T_root_node: dict[int, np.ndarray],
    ax: Axes | None = None,
    *,
    scans: bool = True,
) -> Figure:
    """Draw the nodes of an assembled or relaxed frame, poses `(3,)` in metres and radians.

    Nodes are numbered circles; arcs are lines, those that recognition closed in green;
    references are blue points with a tick in their viewing direction, their scans faint. Where an
    arc does not lead to where the frame has its end, a red line shows the gap: there the frame is
    torn. Nodes that the frame does not hold are left out. `ax` defaults to the axes of a new
    figure. Returns the figure, which belongs to no window.
    """
    places = np.array([T[:2] for T in T_root_node.values()])
    seen = {
        reference: compose(T_root_node[appearance.place.node], appearance.place.T_node_laser)
        for reference, appearance in world.appearances.items()
        if appearance.place.node in T_root_node
    }
    lasers = np.array(list(seen.values())).reshape(-1, 3)
    ax = _new_axes(np.concatenate([places, lasers[:, :2]])) if ax is None else ax
    prepare(ax)
    ax.grid(False)
    if scans:
        _draw_scans(ax, world, seen)
    _draw_arcs(ax, [arc for arc in world.arcs() if arc.a in T_root_node], T_root_node)
    _draw_references(ax, lasers)
    ax.scatter(
        *places.T,
        s=70,
        facecolors="white",
        edgecolors=_DRIVEN,
        linewidths=1.0,
        label=f"nodes ({len(places)})",
        zorder=6,
    )
    for node, T in T_root_node.items():
        ax.annotate(str(node), (T[0], T[1]), ha="center", va="center", fontsize=5.5, zorder=7)
    frame(ax, places, lasers[:, :2], margin=4.0)
    add_legend(ax)
    return figure_of(ax)


def _new_axes(xy: np.ndarray) -> Axes:
    """Axes of a new figure as high as it takes to show the map 11 inches wide."""
    width, height = np.ptp(xy, axis=0) + 8.0
    inches = float(np.clip(11.0 * height / width, 3.0, 14.0))
    return Figure(figsize=(11.8, inches + 1.2), layout="constrained").add_subplot()


def _draw_scans(ax: Axes, world: WorldModel, seen: dict[int, np.ndarray]) -> None:
    points = []
    for reference, pose in seen.items():
        scan = world.reference_scans[reference]
        hit = np.asarray(scan.hit) & (np.asarray(scan.ranges) < _FAR)
        xy = np.asarray(scan.points, float)[hit]
        points.append(compose(pose, np.concatenate([xy, np.zeros((len(xy), 1))], axis=1))[:, :2])
    if points:
        xy = np.concatenate(points)
        ax.scatter(*xy.T, s=0.6, c=_SCANS, linewidths=0, zorder=1, rasterized=True)
        ax.plot([], [], ls="", marker=".", color=_SCANS, label="their scans")


def _draw_arcs(ax: Axes, arcs: list[Arc], T_root_node: dict[int, np.ndarray]) -> None:
    for kind, colour in (("driven", _DRIVEN), ("closed", _CLOSED)):
        lines = [
            (T_root_node[arc.a][:2], T_root_node[arc.b][:2]) for arc in arcs if arc.kind == kind
        ]
        label = f"arcs {kind} ({len(lines)})"
        ax.add_collection(
            LineCollection(lines, colors=colour, linewidths=1.3, label=label, zorder=4)
        )
    gaps = []
    for arc in arcs:
        claimed, drawn = compose(T_root_node[arc.a], arc.T_a_b), T_root_node[arc.b]
        if np.hypot(*(claimed - drawn)[:2]) > _GAP:
            gaps.append((claimed[:2], drawn[:2]))
    if gaps:
        longest = max(float(np.hypot(*(b - a))) for a, b in gaps)
        label = f"torn arcs ({len(gaps)}, up to {longest:.2f} m)"
        ax.add_collection(LineCollection(gaps, colors=_TORN, linewidths=2.2, label=label, zorder=8))


def _draw_references(ax: Axes, poses: np.ndarray) -> None:
    ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=-1)
    ticks = np.stack([poses[:, :2], poses[:, :2] + _TICK * ahead], axis=1)
    ax.add_collection(LineCollection(list(ticks), colors=_REFERENCE, linewidths=0.9, zorder=5))
    label = f"reference scans ({len(poses)}), looking along their ticks"
    ax.scatter(*poses[:, :2].T, s=9, c=_REFERENCE, linewidths=0, label=label, zorder=5)
