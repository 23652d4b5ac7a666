"""The paper's Figs. 4 and 6: a world model assembled into one frame, with what was seen where."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from aprjax.plane import compose
from aprjax.plot.style import (
    FLOOR,
    REFERENCE,
    add_legend,
    draw_poses,
    frame,
    new_axes,
    prepare,
)
from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc

_DRIVEN, _CLOSED, _TORN = "#333333", "#2a8a3e", "#c1272d"
_MARGIN = 4.0  # metres around all places
_TICK = 0.6  # metres, for a reference's viewing direction
_GAP = 0.05  # metres from which an arc is drawn torn
_FAR = 12.0  # metres up to which the points of a scan are drawn


def draw_world(
    world: WorldModel,
    T_root_node: dict[int, np.ndarray],
    *,
    scans: bool = True,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw the nodes of an assembled or relaxed frame, poses `(3,)` in metres and radians.

    Nodes are numbered circles; arcs are lines, those that recognition closed in green;
    references are blue points with a tick in their viewing direction, their scans faint. Where an
    arc does not lead to where the frame has its end, a red line shows the gap: there the frame is
    torn. Nodes that the frame does not hold are left out.
    """
    ax = new_world_axes(world, T_root_node) if ax is None else ax
    places, seen = _nodes(T_root_node), _references(world, T_root_node)
    lasers = _stacked(seen)
    prepare(ax)
    ax.grid(False)
    drawn = _draw_scans(ax, world, seen) if scans else []
    drawn += _draw_arcs(ax, [arc for arc in world.arcs() if arc.a in T_root_node], T_root_node)
    label = "reference scans, looking along their ticks"
    drawn += draw_poses(ax, lasers, REFERENCE, label, tick=_TICK, size=9, zorder=5)
    nodes = ax.scatter(
        *places.T,
        s=70,
        facecolors="white",
        edgecolors=_DRIVEN,
        linewidths=1.0,
        label=f"nodes ({len(places)})",
        zorder=6,
    )
    drawn.append(nodes)
    centred = {"ha": "center", "va": "center", "fontsize": 5.5, "zorder": 9}  # over gaps too
    drawn += [ax.annotate(str(node), (T[0], T[1]), **centred) for node, T in T_root_node.items()]
    frame(ax, places, lasers[:, :2], margin=_MARGIN)
    add_legend(ax)
    return drawn


def new_world_axes(world: WorldModel, T_root_node: dict[int, np.ndarray]) -> Axes:
    """Axes of a new figure that fit the nodes and references of a frame."""
    lasers = _stacked(_references(world, T_root_node))
    xy = np.concatenate([_nodes(T_root_node), lasers[:, :2]])
    return new_axes(np.concatenate([xy - _MARGIN, xy + _MARGIN]), 11.0)


def _nodes(T_root_node: dict[int, np.ndarray]) -> np.ndarray:
    return np.array([T[:2] for T in T_root_node.values()])


def _references(world: WorldModel, T_root_node: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Where the frame has the references, those in nodes that it does not hold left out."""
    return {
        reference: compose(T_root_node[appearance.place.node], appearance.place.T_node_laser)
        for reference, appearance in world.appearances.items()
        if appearance.place.node in T_root_node
    }


def _stacked(poses: dict[int, np.ndarray]) -> np.ndarray:
    return np.array(list(poses.values())).reshape(-1, 3)


def _draw_scans(ax: Axes, world: WorldModel, seen: dict[int, np.ndarray]) -> list[Artist]:
    points = []
    for reference, pose in seen.items():
        scan = world.reference_scans[reference]
        hit = np.asarray(scan.hit) & (np.asarray(scan.ranges) < _FAR)
        xy = np.asarray(scan.points, float)[hit]
        points.append(compose(pose, np.concatenate([xy, np.zeros((len(xy), 1))], axis=1))[:, :2])
    if not points:
        return []
    xy = np.concatenate(points)
    dots = ax.scatter(*xy.T, s=0.6, c=FLOOR, linewidths=0, zorder=1, rasterized=True)
    return [dots, *ax.plot([], [], ls="", marker=".", color=FLOOR, label="their scans")]


def _draw_arcs(ax: Axes, arcs: list[Arc], T_root_node: dict[int, np.ndarray]) -> list[Artist]:
    drawn: list[Artist] = []
    for kind, colour in (("driven", _DRIVEN), ("closed", _CLOSED)):
        lines = [
            (T_root_node[arc.a][:2], T_root_node[arc.b][:2]) for arc in arcs if arc.kind == kind
        ]
        label = f"arcs {kind} ({len(lines)})"
        found = LineCollection(lines, colors=colour, linewidths=1.3, label=label, zorder=4)
        drawn.append(ax.add_collection(found))
    gaps = []
    for arc in arcs:
        claimed, held = compose(T_root_node[arc.a], arc.T_a_b), T_root_node[arc.b]
        if np.hypot(*(claimed - held)[:2]) > _GAP:
            gaps.append((claimed[:2], held[:2]))
    if gaps:
        longest = max(float(np.hypot(*(b - a))) for a, b in gaps)
        label = f"torn arcs ({len(gaps)}, up to {longest:.2f} m)"
        torn = LineCollection(gaps, colors=_TORN, linewidths=2.2, label=label, zorder=8)
        drawn.append(ax.add_collection(torn))
    return drawn
