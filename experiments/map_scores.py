"""How good a world model is against the true poses of its log's scans.

The figures of `score_map.py`, which lies beside the data, on a model rather than on its export;
how far the relaxed frame is off as a whole; and how good the truth is from scan to scan.
"""

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import networkx as nx
import numpy as np

from aprjax.plane import compose, distance, relative, wrap
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion

_WRONG, _WRONG_TURN = 1.0, np.radians(15)  # metres and radians from which a pose is false
_AGAIN, _AGAIN_TURN = 1.5, np.radians(30)  # metres and radians within which a place is the same
_EARLIER = 20.0  # metres of way before it counts as a place passed before
_ARCS = 3  # between the nodes of two scans that are compared


def score_map(world: WorldModel, T_world_laser: np.ndarray) -> dict[str, float]:
    """The figures by name, given the truth `(scans, 3)` of all scans of the log.

    arc_m, arc_deg: median error of the arcs, and the 95th percentile. false_arcs: those off by
    over 1 m or 15°; false_places: share of the scans placed so far off in their node. place_m_95:
    95th percentile of the scans' distance from their node. revisits: scans within 1.5 m and 30°
    of one more than 20 m of way earlier; recognized: share of them whose pose relative to such a
    one, composed along the fewest arcs, three at most, is not false.
    """
    frames = {node: T_world_laser[world.graph.nodes[node]["scan"]] for node in world.nodes}
    arcs = list(world.arcs())
    off = [relative(arc.T_a_b, relative(frames[arc.a], frames[arc.b])) for arc in arcs]
    arc_errors = np.array(off).reshape(-1, 3)
    metres, degrees = distance(arc_errors), np.degrees(np.abs(wrap(arc_errors[:, 2])))
    nodes = [world.places[scan].node for scan in range(len(T_world_laser))]
    placed = np.array([world.places[scan].T_node_laser for scan in range(len(T_world_laser))])
    true = relative(np.array([frames[node] for node in nodes]), T_world_laser)
    revisits, recognized = _recognized(world, T_world_laser, nodes, placed)
    return {
        "nodes": len(frames),
        "references": len(world.appearances),
        "arcs": len(arcs),
        "closed": sum(arc.kind == "closed" for arc in arcs),
        "false_arcs": int(np.sum(_false(arc_errors))),
        "arc_m": float(np.median(metres)),
        "arc_m_95": float(np.percentile(metres, 95)),
        "arc_deg": float(np.median(degrees)),
        "arc_deg_95": float(np.percentile(degrees, 95)),
        "false_places": float(np.mean(_false(relative(true, placed)))),
        "place_m_95": float(np.percentile(distance(placed), 95)),
        "revisits": revisits,
        "recognized": recognized / revisits if revisits else np.nan,
    }


def frame_rms(
    world: WorldModel, T_root_node: dict[int, np.ndarray], T_world_laser: np.ndarray
) -> float:
    """Metres, root mean square, between the nodes of an assembled frame and the truth.

    The frame is moved as a whole to where it fits the truth best.
    """
    assembled = np.array([T[:2] for T in T_root_node.values()])
    scans = [world.graph.nodes[node]["scan"] for node in T_root_node]
    true = T_world_laser[scans, :2]
    assembled, true = assembled - assembled.mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(assembled.T @ true)
    turn = u @ np.diag([1.0, np.linalg.det(u @ vt)]) @ vt
    return float(np.sqrt(np.mean(np.sum((assembled @ turn - true) ** 2, axis=1))))


def pair_errors(moved: Motion, T_world_laser: np.ndarray) -> dict[str, float]:
    """Medians over all aligned pairs of scans, by name.

    pair_deg_true: by how much the turn between two scans is off the truth. pair_deg: off what all
    pairs together say. Where that is much less, scans agree with each other on headings that the
    truth does not have.
    """
    first, second = (
        numbers[len(T_world_laser) - 1 :]  # odometry's steps come first
        for numbers in (moved.measured.first, moved.measured.second)
    )
    turn = moved.measured.T_first_second[len(T_world_laser) - 1 :, 2]
    off = {}
    for name, poses in (("pair_deg_true", T_world_laser), ("pair_deg", moved.poses)):
        gap = wrap(poses[second, 2] - poses[first, 2] - turn)
        off[name] = float(np.degrees(np.median(np.abs(gap))))
    return off


def _false(errors: np.ndarray) -> np.ndarray:
    """Of errors `(..., 3)`."""
    return (distance(errors) > _WRONG) | (np.abs(wrap(errors[..., 2])) > _WRONG_TURN)


def _recognized(
    world: WorldModel, truth: np.ndarray, nodes: list[int], placed: np.ndarray
) -> tuple[int, int]:
    """How many scans are at a place passed before, and how many of them the model has there."""
    way = np.concatenate([[0.0], np.cumsum(distance(np.diff(truth, axis=0)))])
    link = _links(world)
    revisits = recognized = 0
    for scan in range(len(truth)):
        step = truth[:scan] - truth[scan]
        near = (distance(step) < _AGAIN) & (np.abs(wrap(step[:, 2])) < _AGAIN_TURN)
        earlier = np.flatnonzero(near & (way[scan] - way[:scan] > _EARLIER))
        revisits += bool(len(earlier))
        for other in earlier:
            along = link(nodes[other], nodes[scan])
            if along is not None:
                claimed = relative(placed[other], compose(along, placed[scan]))
                if not _false(relative(relative(truth[other], truth[scan]), claimed)):
                    recognized += 1
                    break
    return revisits, recognized


def _links(world: WorldModel) -> Callable[[int, int], np.ndarray | None]:
    """Poses between nodes, composed along the fewest arcs, or None where that is too many.

    Of paths with as few arcs the script beside the data takes the first that networkx finds, so
    the nodes and arcs are listed here in the order of the export.
    """
    graph = nx.Graph()
    graph.add_nodes_from(world.nodes)
    graph.add_edges_from((arc.a, arc.b) for arc in world.arcs())

    @cache
    def link(start: int, end: int) -> np.ndarray | None:
        try:
            path = nx.shortest_path(graph, start, end)
        except nx.NetworkXNoPath:
            return None
        if len(path) > _ARCS + 1:
            return None
        T = np.zeros(3)
        for a, b in pairwise(path):
            T = compose(T, world.arc(a, b).T_a_b)
        return T

    return link
