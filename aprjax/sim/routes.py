"""Ways through a floor's free areas, as robots and people go them."""

from typing import NamedTuple

import networkx as nx
import numpy as np

_LANE = 2.5  # metres along a corridor from where on one settles for a lane in it
_ROUNDED = 0.25  # metres that a way may cut a corner in the middle of an area


class Waypoint(NamedTuple):
    """A corner of a way."""

    xy: np.ndarray
    """`(2,)` in metres."""
    cut: float
    """Metres that a rounded way may pass beside the corner and stay in the free areas."""


def point_in(rng: np.random.Generator, rectangle: np.ndarray) -> np.ndarray:
    """A random point `(2,)`."""
    return rng.uniform(rectangle[0], rectangle[1])


def route(
    rng: np.random.Generator,
    areas: nx.Graph,
    start: tuple[int, np.ndarray],
    goal: tuple[int, np.ndarray],
    sharp: float,
) -> list[Waypoint]:
    """Waypoints after `start` up to `goal`, both an area and a point in it.

    Along corridors the way keeps a random distance from the walls. Where it goes from one area
    into the next, corners are cut by at most `sharp` metres.
    """
    nodes = nx.shortest_path(areas, start[0], goal[0])
    at, way = start[1], []
    for node, following in zip(nodes, [*nodes[1:], None], strict=True):
        if following is None:
            target = Waypoint(goal[1], _ROUNDED)
        else:
            target = Waypoint(point_in(rng, areas.edges[node, following]["overlap"]), sharp)
        way += [*_lane(rng, areas.nodes[node], at, target.xy), target]
        at = target.xy
    return way


def _lane(
    rng: np.random.Generator, area: dict, start: np.ndarray, end: np.ndarray
) -> list[Waypoint]:
    """The corners where a way along a corridor enters and leaves its lane."""
    low, high = area["rectangle"]
    along = int(np.argmax(high - low))
    ahead = end[along] - start[along]
    if area["kind"] != "corridor" or abs(ahead) < _LANE:
        return []
    lane = rng.uniform(low, high)
    first, last = np.sign(ahead) * rng.uniform(0.5, 1.1, 2)
    corners = np.stack([lane, lane])
    corners[0, along], corners[1, along] = start[along] + first, end[along] - last
    return [Waypoint(corner, _ROUNDED) for corner in corners]
