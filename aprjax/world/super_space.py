"""The super space (paper section 4): poses of different nodes, compared along the arcs.

Local configuration spaces have no common frame; a pose is carried from one into another by
composing the arcs of a path, and each arc adds its error. Two paths to one node need not agree: the
difference is the residual of the cycle they form, and where it is large the map is torn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np

from aprjax.plane import compose, compose_covariance, distance, relative, spread, turn_spread
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place, WorldModelError

_TURN = 3.0  # metres that a heading is off in the place of what is seen with it


@dataclass(frozen=True, eq=False)
class Connection:
    """A node's frame as another node sees it, along one path of arcs."""

    T_start_end: np.ndarray
    """`(3,)` metres, radians."""
    covariance: np.ndarray
    """`(3, 3)` of `T_start_end`: the sum of what each arc adds."""
    path: tuple[int, ...]
    """The nodes from start to end."""
    length: float
    """Metres along the arcs."""

    def then(self, world: WorldModel, node: int) -> "Connection":
        """Continued along the arc to a neighbour of the end."""
        arc = world.arc(self.path[-1], node)
        return Connection(
            compose(self.T_start_end, arc.T_a_b),
            compose_covariance(self.T_start_end, self.covariance, arc.T_a_b, arc.covariance),
            (*self.path, node),
            self.length + arc.length,
        )


@dataclass(frozen=True, eq=False)
class Cycle:
    """A cycle of arcs, and by how much its end misses its start."""

    nodes: tuple[int, ...]
    """Each once, in order."""
    T_residual: np.ndarray
    """`(3,)`: the start's frame as the way round the cycle has it; zero if nothing is torn."""
    covariance: np.ndarray
    """`(3, 3)` that the arcs claim for it."""
    length: float
    """Metres."""

    @property
    def torn(self) -> bool:
        """Whether the arcs' errors do not explain the residual: beyond 99.9 % of a χ²."""
        # The residual's own numerical noise, where all arcs are exact.
        floor = np.diag([1e-6, 1e-6, 1e-8])
        square = self.T_residual @ np.linalg.solve(self.covariance + floor, self.T_residual)
        return bool(square > 16.27)


def connections(world: WorldModel, start: int, reach: float = np.inf) -> dict[int, Connection]:
    """Every node at most `reach` metres along the arcs from `start`.

    Each along the path of the least uncertain arcs, or, where that is longer than `reach`, along
    the shortest one. Raises `WorldModelError` for an unknown node.
    """
    if start not in world.graph:
        raise WorldModelError(f"node {start}: there is none")
    search: Any = nx.single_source_dijkstra
    lengths, shortest = search(world.graph, start, cutoff=reach, weight=_length)

    def weight(a: int, b: int, attributes: dict) -> float | None:
        return _uncertainty(a, b, attributes) if b in lengths else None  # no way leads there

    uncertainties, surest = search(world.graph, start, weight=weight)
    found = {start: _along(world, [start])}
    # They are listed as nodes are settled, predecessors first; paths are not.
    for node in uncertainties:
        if node != start and surest[node][-2] in found:
            connection = found[surest[node][-2]].then(world, node)
            if connection.length <= reach:
                found[node] = connection
    for node in lengths:
        if node not in found:
            found[node] = _along(world, shortest[node])
    return found


def neighbourhood(world: WorldModel, start: int, arcs: int) -> dict[int, Connection]:
    """The nodes at most so many `arcs` away, along the fewest."""
    found = {start: _along(world, [start])}
    fringe = [start]
    for _ in range(arcs):
        reached = []
        for node in fringe:
            for neighbour in sorted(world.graph[node]):
                if neighbour not in found:
                    found[neighbour] = found[node].then(world, neighbour)
                    reached.append(neighbour)
        fringe = reached
    return found


def between(world: WorldModel, one: Place, other: Place) -> tuple[np.ndarray, np.ndarray]:
    """The pose of `other` in the frame of the pose `one`, and the covariance the arcs give it.

    Raises `WorldModelError` where no path leads from one node to the other.
    """
    known = connections(world, one.node)
    if other.node not in known:
        raise WorldModelError(f"nodes {one.node} and {other.node}: no path connects them")
    link = known[other.node]
    T = relative(one.T_node_laser, compose(link.T_start_end, other.T_node_laser))
    exact = np.zeros((3, 3))
    covariance = compose_covariance(link.T_start_end, link.covariance, other.T_node_laser, exact)
    cos, sin = np.cos(one.T_node_laser[2]), np.sin(one.T_node_laser[2])
    turned = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return T, turned @ covariance @ turned.T


def cycles(world: WorldModel) -> list[Cycle]:
    """The residuals of a basis of independent cycles, shortest cycles first."""
    found = []
    plain: Any = nx.Graph()
    plain.add_weighted_edges_from((arc.a, arc.b, arc.length) for arc in world.arcs())
    for nodes in nx.minimum_cycle_basis(plain, weight="weight"):
        ordered = _in_order(world.graph, nodes)
        way = _along(world, [*ordered, ordered[0]])
        found.append(Cycle(ordered, way.T_start_end, way.covariance, way.length))
    return sorted(found, key=lambda cycle: (cycle.length, cycle.nodes))


def assemble(world: WorldModel, root: int | None = None) -> dict[int, np.ndarray]:
    """The contorted frame of `root`, by default the first node: poses `(3,)` of all it reaches.

    Raises `WorldModelError` for an unknown root, and for a model without nodes.
    """
    if root is None:
        if not world.nodes:
            raise WorldModelError("world: there is no node")
        root = world.nodes[0]
    return {node: found.T_start_end for node, found in connections(world, root).items()}


def residuals(world: WorldModel, frame: dict[int, np.ndarray]) -> np.ndarray:
    """How far each arc between nodes of an assembled `frame` is off in it: `(arcs, 3)`."""
    off = [
        relative(arc.T_a_b, relative(frame[arc.a], frame[arc.b]))
        for arc in world.arcs()
        if arc.a in frame and arc.b in frame
    ]
    return np.array(off).reshape(-1, 3)


def largest_gap(cycles_: list[Cycle]) -> float:
    """Metres by which the worst cycle misses its start; zero without cycles."""
    return max((float(distance(cycle.T_residual)) for cycle in cycles_), default=0.0)


def _along(world: WorldModel, path: Sequence[int]) -> Connection:
    """The last node of a path as the first one sees it."""
    way = Connection(np.zeros(3), np.zeros((3, 3)), (path[0],), 0.0)
    for node in path[1:]:
        way = way.then(world, node)
    return way


def _length(a: int, b: int, attributes: dict) -> float:
    return attributes["arc"].length


def _uncertainty(a: int, b: int, attributes: dict) -> float:
    arc = attributes["arc"]
    return spread(arc.covariance) + _TURN * turn_spread(arc.covariance) + 1e-6


def _in_order(graph: nx.Graph, nodes: list[int]) -> tuple[int, ...]:
    """The nodes of a cycle one after the other, from the lowest to its lower neighbour.

    networkx promises no order, but keeps one. Without it, the shortest arcs are tried first: where
    the map is torn, an arc between two of the nodes may be longer than the way round.
    """
    if not all(graph.has_edge(a, b) for a, b in pairwise([*nodes, nodes[0]])):
        nodes = _way_round(graph, nodes)
    first = nodes.index(min(nodes))
    ordered = nodes[first:] + nodes[:first]
    return tuple(ordered if ordered[1] < ordered[-1] else ordered[:1] + ordered[:0:-1])


def _way_round(graph: nx.Graph, nodes: list[int]) -> list[int]:
    """The nodes of a cycle in an order in which arcs connect them."""
    ways = [[nodes[0]]]
    while ways:
        way = ways.pop()
        if len(way) == len(nodes) and graph.has_edge(way[-1], way[0]):
            return way
        ahead = [node for node in graph[way[-1]] if node in nodes and node not in way]
        ahead.sort(key=lambda node: -graph.edges[way[-1], node]["arc"].length)
        ways += [[*way, node] for node in ahead]
    raise WorldModelError(f"nodes {nodes}: no cycle of arcs")
