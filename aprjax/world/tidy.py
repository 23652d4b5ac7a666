"""What a second pass left double: nodes at one place, and arcs that only cut a corner.

Where the robot did not know at once that it was back, it made new nodes beside the old ones, and
recognition joined them later. One place is one node, and two ways between neighbours are one.
"""

import networkx as nx

from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc
from aprjax.world.plane import distance, spread
from aprjax.world.super_space import neighbourhood

_ARCS = 2  # between nodes that may be one


def merge_close_nodes(world: WorldModel, gap: float, deviation: float) -> None:
    """Make nodes one that lie less than `gap` metres apart, at most two arcs from each other.

    The arcs between them must be certain to `deviation` metres. The older node stays.
    """
    for node in world.nodes:
        while node in world.graph:
            near = [
                (float(distance(link.T_start_end)), other, link)
                for other, link in neighbourhood(world, node, _ARCS).items()
                if other > node
                and distance(link.T_start_end) < gap
                and spread(link.covariance) < deviation
            ]
            if not near:
                break
            _, other, link = min(near, key=lambda entry: entry[:2])
            if not world.graph.has_edge(node, other):
                world.add_arc(Arc(node, other, link.T_start_end, link.covariance, "closed"))
            world.merge_nodes(node, other)


def drop_shortcuts(world: WorldModel, detour: float) -> None:
    """Remove arcs beside which two others lead the same way, not `detour` times as long.

    The least certain go first.
    """
    for arc in sorted(world.arcs(), key=lambda arc: (-spread(arc.covariance), arc.a, arc.b)):
        common = nx.common_neighbors(world.graph, arc.a, arc.b)
        ways = [world.arc(arc.a, n).length + world.arc(n, arc.b).length for n in common]
        if ways and min(ways) < detour * arc.length:
            world.remove_arc(arc.a, arc.b)
