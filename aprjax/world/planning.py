"""Paths as graph search (paper section 1): which arcs to drive, and how to turn between them."""

import math
from dataclasses import dataclass
from itertools import pairwise

import networkx as nx

from aprjax.world.model import WorldModel
from aprjax.world.parts import WorldModelError


class PlanError(WorldModelError):
    """There is no such path. One line: which node is unknown or out of reach."""


@dataclass(frozen=True)
class Leg:
    """One arc of a path."""

    start: int
    end: int
    length: float
    """Metres between the nodes' origins."""
    turn: float
    """Radians to turn at `start`, counter-clockwise, coming from the leg before; zero for the
    first."""
    kind: str
    """Of the arc."""


@dataclass(frozen=True)
class Plan:
    """A shortest path."""

    nodes: tuple[int, ...]
    legs: tuple[Leg, ...]

    @property
    def length(self) -> float:
        """Metres."""
        return sum(leg.length for leg in self.legs)


def plan(world: WorldModel, start: int, goal: int) -> Plan:
    """The shortest way along the arcs. Raises `PlanError` if a node is unknown or out of reach."""
    for node in (start, goal):
        if node not in world.graph:
            raise PlanError(f"node {node}: the map has none, only {_span(world)}")
    try:
        nodes = nx.shortest_path(world.graph, start, goal, weight=_length)
    except nx.NetworkXNoPath:
        raise PlanError(f"node {goal}: no arcs lead there from {start}") from None
    legs = []
    for index, (here, there) in enumerate(pairwise(nodes)):
        arc = world.arc(here, there)
        turn = 0.0
        if index:
            back = world.arc(here, nodes[index - 1]).T_a_b
            arriving = math.atan2(-back[1], -back[0])
            leaving = math.atan2(arc.T_a_b[1], arc.T_a_b[0])
            turn = math.remainder(leaving - arriving, math.tau)
        legs.append(Leg(here, there, arc.length, turn, arc.kind))
    return Plan(tuple(nodes), tuple(legs))


def _length(a: int, b: int, attributes: dict) -> float:
    return attributes["arc"].length


def _span(world: WorldModel) -> str:
    return f"{world.nodes[0]} to {world.nodes[-1]}" if world.nodes else "none"
