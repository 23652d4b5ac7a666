"""Seeded floors of an office building, cut at the height of the scanner.

Where the robot may be is a graph of rectangles that no furniture enters: a strip of each
corridor, a passage through each door that it uses, and an area in each room behind one. A
straight way inside a rectangle is free, whatever people move.
"""

from dataclasses import dataclass, replace

import networkx as nx
import numpy as np

from aprjax.plane import transform
from aprjax.sim.furnish import PROGRAMMES, Space, furnish, furnish_corridor
from aprjax.sim.furniture import Piece
from aprjax.sim.layout import Layout, layout
from aprjax.sim.rectangle import grown, overlap, transform_rectangle
from aprjax.sim.structure import (
    CLEARANCE,
    corridor_features,
    doorway,
    robot_areas,
    room_features,
)
from aprjax.sim.walls import Door, outline
from aprjax.sim.world import World

_SIDE = 0.42  # metres along each wall of a corridor that furniture may take
_END = 0.55  # metres before the end walls of a corridor where the robot turns back


@dataclass(frozen=True)
class FloorPlan:
    """A floor at one time; arrays are NumPy's, in metres and radians."""

    walls: np.ndarray
    """`(W, 2, 2)`."""
    doors: tuple[Door, ...]
    furniture: tuple[Piece, ...]
    areas: nx.Graph
    """Where the robot's centre may be. Each node's `rectangle` `(2, 2)` holds its low and its high
    corner, its `kind` is corridor, door or room; each edge's `overlap` is what two share."""

    def world(self) -> World:
        """What a scanner can hit."""
        pieces = [piece.surfaces for piece in self.furniture]
        leaves = [door.leaf[None] for door in self.doors]
        return World.make(
            np.concatenate([self.walls, *leaves, *(segments for segments, _ in pieces)]),
            np.concatenate([np.zeros((0, 3)), *(circles for _, circles in pieces)]),
        )

    def rearranged(self, seed: int, share: float = 0.5) -> "FloorPlan":
        """The floor at another time: of what can move, about `share` was moved.

        Doors stand otherwise, chairs and waste baskets elsewhere, some things are gone or back.
        Walls and the robot's areas are the same, and doors that it uses are open. Raises
        `ValueError` for a share that is not from 0 to 1.
        """
        if not 0 <= share <= 1:
            raise ValueError(f"share: {share} is not from 0 to 1")
        rng = np.random.default_rng(seed)
        return replace(
            self,
            doors=tuple(d.moved(rng) if rng.random() < share else d for d in self.doors),
            furniture=tuple(p.moved(rng) if rng.random() < share else p for p in self.furniture),
        )


def office(seed: int, clutter: float = 1.0, visited: int = 5) -> FloorPlan:
    """A floor of 19 to 24 m by 10.5 to 14 m with about ten rooms.

    `clutter` scales the number of pieces of furniture; `visited` is how many rooms the robot
    enters, or all if there are fewer. Raises `ValueError` if one is negative.
    """
    for name, value in (("clutter", clutter), ("visited", visited)):
        if not value >= 0:
            raise ValueError(f"{name}: {value} is negative or no number")
    rng = np.random.default_rng(seed)
    plan = layout(rng)
    strips = [_strip(plan, index) for index in range(len(plan.corridors))]
    entered = set(rng.permutation(len(plan.rooms))[:visited].tolist())

    walls, doors, openings = [], [], []
    furniture: list[Piece] = []
    areas = [("corridor", strip) for strip in strips]
    for index, room in enumerate(plan.rooms):
        door, opening = doorway(rng, room, passable=index in entered)
        swept = np.array([(opening[0] - 1.0, -1.0), (opening[1] + 1.0, 1.0)])
        taken = [swept]
        if index in entered:
            across = room.wall + _across(plan, strips, room.corridor)
            passage, area = robot_areas(rng, room, opening, across)
            taken += [grown(passage, CLEARANCE), grown(area, CLEARANCE)]
            areas += [
                ("door", transform_rectangle(room.T_world_room, passage)),
                ("room", transform_rectangle(room.T_world_room, area)),
            ]
        features, pillars = room_features(rng, room, opening, taken)
        jambs = np.array([[(x, 0.0), (x, -room.wall)] for x in opening])
        faces = np.concatenate([outline(room.corners, features), jambs])
        walls.append(transform(room.T_world_room, faces))
        doors.append(door)
        openings.append(transform(room.T_world_room, jambs[:, 1]))
        space = Space(rng, room.T_world_room, (room.width, room.depth), [*taken, *pillars])
        kind = rng.choice(list(PROGRAMMES), p=[0.45, 0.12, 0.2, 0.13, 0.1])
        furniture += furnish(space, str(kind), clutter * rng.uniform(0.6, 1.4))

    features, pillars = corridor_features(rng, plan, openings, depth=0.6 * _SIDE)
    walls.append(outline(plan.corridor_corners, features))
    taken = [*pillars, *(grown(strip, CLEARANCE) for strip in strips)]
    taken += [grown(np.stack([o.min(axis=0), o.max(axis=0)]), 0.1) for o in openings]
    taken += [grown(corridor, 0.05) for corridor in plan.corridors[1:]]
    for index, (low, high) in enumerate(plan.corridors):
        here = [area - low for area in (taken if index == 0 else taken[:-1])]
        space = Space(rng, np.array([*low, 0.0]), tuple(high - low), here)
        furniture += furnish_corridor(space, (index, index + 2), _SIDE - 0.04, clutter)
    return FloorPlan(np.concatenate(walls), tuple(doors), tuple(furniture), _graph(areas))


def _strip(plan: Layout, index: int) -> np.ndarray:
    """The middle of a corridor, clear of the furniture at its walls."""
    (left, low), (right, high) = grown(plan.corridors[index], -CLEARANCE - _SIDE)
    if index == 0:
        ends = plan.corridors[0][:, 0] + (_END, -_END)
        return np.array([(ends[0], low), (ends[1], high)])
    # An arm's strip starts across the main corridor's.
    crossing = _strip(plan, 0)[0, 1]
    return np.array([(left, crossing), (right, plan.corridors[1][1, 1] - _END)])


def _across(plan: Layout, strips: list[np.ndarray], index: int) -> float:
    """Metres from a corridor's wall to the far side of the strip in it."""
    axis = 1 - index
    return float(strips[index][1, axis] - plan.corridors[index][0, axis])


def _graph(areas: list[tuple[str, np.ndarray]]) -> nx.Graph:
    """Which areas can be reached from which."""
    graph = nx.Graph()
    for node, (kind, rectangle) in enumerate(areas):
        graph.add_node(node, kind=kind, rectangle=rectangle)
        for other in range(node):
            shared = overlap(rectangle, areas[other][1])
            # Passages of opposite doors cross, but no robot turns from one into the other.
            if shared is not None and (kind, areas[other][0]) != ("door", "door"):
                graph.add_edge(other, node, overlap=shared)
    return graph
