"""The geometry of arcs from all that was measured around them."""

import numpy as np

from aprjax.plane import compose, relative, spread, turn_spread
from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc
from aprjax.world.smoothing import Measurements, relative_covariance, smooth

FLOOR = np.diag(np.square([0.02, 0.02, np.radians(0.3)]))
"""What the error model of the scans leaves out, as a covariance."""


def fit_arcs(world: WorldModel, measured: Measurements) -> None:
    """Estimate every arc anew from the measurements between scans placed at its ends.

    Each by itself, from what was measured at its two nodes: the arcs around a cycle know nothing
    of each other, and its residual tells how good they are. `measured` names scans by number; a
    node's own scan must be placed in it. An arc that the scans hold no better stays.
    """
    by_node: dict[int, list[int]] = {node: [] for node in world.graph}
    for scan, place in world.places.items():
        by_node[place.node].append(scan)
    for arc in list(world.arcs()):
        fitted = _fit(world, arc, by_node, measured)
        if fitted is not None:
            world.replace_arc(fitted)


def _fit(
    world: WorldModel, arc: Arc, by_node: dict[int, list[int]], measured: Measurements
) -> Arc | None:
    around = _around(world, arc)
    scans = np.array(sorted(scan for node in around for scan in by_node[node]))
    frames = [world.graph.nodes[node]["scan"] for node in (arc.a, arc.b)]
    if not all(frame in scans for frame in frames):
        return None
    inside = np.isin(measured.first, scans) & np.isin(measured.second, scans)
    local = measured.take(inside)
    local = Measurements(
        np.searchsorted(scans, local.first),
        np.searchsorted(scans, local.second),
        local.T_first_second,
        local.root,
    )
    start = []
    for scan in scans:
        place = world.places[int(scan)]
        start.append(compose(around[place.node], place.T_node_laser))
    first, second = (int(np.searchsorted(scans, frame)) for frame in frames)
    poses = smooth(np.array(start), local, first)
    covariance = relative_covariance(poses, local, first, second) + FLOOR
    held = spread(covariance) < 2 * spread(arc.covariance) and turn_spread(
        covariance
    ) < 2 * turn_spread(arc.covariance)
    if not held:
        return None
    return Arc(arc.a, arc.b, relative(poses[first], poses[second]), covariance, arc.kind)


def _around(world: WorldModel, arc: Arc) -> dict[int, np.ndarray]:
    """The frames of an arc's nodes and of all their neighbours in that of its first node."""
    frames = {arc.a: np.zeros(3), arc.b: arc.T_a_b}
    for node in (arc.a, arc.b):
        for neighbour in sorted(world.graph[node]):
            if neighbour not in frames:
                frames[neighbour] = compose(frames[node], world.arc(node, neighbour).T_a_b)
    return frames
