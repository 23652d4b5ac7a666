"""What only the whole drive shows: better frames, nodes at one place, arcs that only cut a corner.

A node begins with the scan that needed it, which may be a poor frame. Where the robot did not know
at once that it was back, it made new nodes beside the old ones, and recognition joined them later.
One place is one node, a crossing too, and two ways between neighbours are one.
"""

import networkx as nx
import numpy as np

from aprjax.plane import distance, spread, turn_spread
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion
from aprjax.world.parts import Arc
from aprjax.world.super_space import neighbourhood

_ARCS = 2  # between nodes that may be one
_SURE, _SURE_TURN = 0.3, np.radians(4)  # metres and radians: deviations of a pose that may be one
_ABOUT = 2.0  # metres about a scan in which turning counts
_SKEWED = np.radians(15)  # from which a heading is not to be relied on
_OUTLYING = np.radians(15)  # radians of turning that a metre off the middle of the scans counts
_UNCERTAIN = 400.0  # radians of turning that a radian of the heading's deviation counts


def steady_frames(world: WorldModel, moved: Motion, covariance: dict[int, np.ndarray]) -> None:
    """Give each node the frame of a scan about its middle that is well held and not of a turn.

    An error of the frame's own heading is one of all its arcs. The headings of scans are the less
    certain the less the scans around them hold them, and the more the robot turned: a scan lasts
    some time, and one that was taken in a turn is skewed. Nor is one a good frame that is skewed
    against odometry. `covariance` `(3, 3)` is that of each scan's pose in its node.
    """
    skew, uncertain = moved.skew(), moved.heading_deviation()
    inside: dict[int, list[int]] = {node: [] for node in world.graph}
    for scan, place in sorted(world.places.items()):
        if spread(covariance[scan]) < _SURE and turn_spread(covariance[scan]) < _SURE_TURN:
            inside[place.node].append(scan)
    for node, scans in inside.items():
        if scans:
            xy = np.array([world.places[scan].T_node_laser[:2] for scan in scans])
            off = np.hypot(*(xy - np.median(xy, axis=0)).T)
            turns = np.array([moved.turn(scan, _ABOUT) for scan in scans])
            cost = turns + _OUTLYING * off + _UNCERTAIN * uncertain[scans]
            chosen = scans[np.lexsort((cost, skew[scans] > _SKEWED))[0]]
            world.move_frame(node, chosen, covariance[chosen])


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


def drop_small_cycles(world: WorldModel, around: float) -> None:
    """Remove the longest arc of each cycle that is shorter than `around` metres.

    Where a robot passed a crossing in several directions, arcs cut its corners: so small a cycle
    encloses nothing.
    """
    lengths = nx.Graph()
    lengths.add_weighted_edges_from((arc.a, arc.b, arc.length) for arc in world.arcs())
    for a, b, length in sorted(lengths.edges(data="weight"), key=lambda edge: -edge[2]):
        lengths.remove_edge(a, b)
        back = nx.single_source_dijkstra_path_length(lengths, a, cutoff=around - length)
        if b in back:
            world.remove_arc(a, b)
        else:
            lengths.add_edge(a, b, weight=length)


def merge_crossings(world: WorldModel, gap: float, deviation: float) -> None:
    """Make one node of two neighbouring ones less than `gap` metres apart where ways meet at both.

    What crosses within the region of a node crosses in one place. The arc between them must be
    certain to `deviation` metres. The shortest go first; the older node stays.
    """
    while near := [
        (arc.length, arc.a, arc.b)
        for arc in world.arcs()
        if arc.length < gap
        and spread(arc.covariance) < deviation
        and world.graph.degree(arc.a) > 2
        and world.graph.degree(arc.b) > 2
    ]:
        _, a, b = min(near)
        world.merge_nodes(min(a, b), max(a, b))
