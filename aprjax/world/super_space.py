"""The super space (paper section 4): poses of different nodes, compared along the arcs.

Local configuration spaces have no common frame; a pose is carried from one into another by
composing the arcs of a path, and each arc adds its error. Two paths to one node need not agree: the
difference is the residual of the cycle they form, and where it is large the map is torn.
"""

from dataclasses import dataclass
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
    """Every node that can be reached from `start`, along the path of the least uncertain arcs.

    `reach` bounds the metres along the arcs. Raises `WorldModelError` for an unknown node.
    """
    if start not in world.graph:
        raise WorldModelError(f"node {start}: there is none")
    search: Any = nx.single_source_dijkstra
    distances, paths = search(world.graph, start, weight=_uncertainty)
    found = {start: Connection(np.zeros(3), np.zeros((3, 3)), (start,), 0.0)}
    # Distances are listed as nodes are settled, predecessors first; paths are not.
    for node in distances:
        if node != start and paths[node][-2] in found:
            connection = found[paths[node][-2]].then(world, node)
            if connection.length <= reach:
                found[node] = connection
    return found


def neighbourhood(world: WorldModel, start: int, arcs: int) -> dict[int, Connection]:
    """The nodes at most so many `arcs` away, along the fewest."""
    found = {start: Connection(np.zeros(3), np.zeros((3, 3)), (start,), 0.0)}
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
        way = Connection(np.zeros(3), np.zeros((3, 3)), (ordered[0],), 0.0)
        for node in (*ordered[1:], ordered[0]):
            way = way.then(world, node)
        found.append(Cycle(ordered, way.T_start_end, way.covariance, way.length))
    return sorted(found, key=lambda cycle: (cycle.length, cycle.nodes))


def assemble(world: WorldModel, root: int | None = None) -> dict[int, np.ndarray]:
    """The contorted frame of `root`, by default the first node: poses `(3,)` of all it reaches."""
    root = world.nodes[0] if root is None else root
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


def _uncertainty(a: int, b: int, attributes: dict) -> float:
    arc = attributes["arc"]
    return spread(arc.covariance) + _TURN * turn_spread(arc.covariance) + 1e-6


def _in_order(graph: nx.Graph, nodes: list[int]) -> tuple[int, ...]:
    """The nodes of a cycle one after the other, from the lowest.

    Where the map is torn, an arc between two of them may be longer than the way round.
    """
    inside = nx.Graph(graph.subgraph(nodes))
    arcs = sorted(inside.edges(data="arc"), key=lambda edge: (-edge[2].length, edge[:2]))
    for a, b, _ in arcs:
        if inside.degree[a] > 2 and inside.degree[b] > 2:
            inside.remove_edge(a, b)
    start = min(nodes)
    ordered, before = [start, min(inside[start])], start
    while len(ordered) < len(nodes):
        following = next(n for n in inside[ordered[-1]] if n not in (before, ordered[-1]))
        before = ordered[-1]
        ordered.append(following)
    return tuple(ordered)
