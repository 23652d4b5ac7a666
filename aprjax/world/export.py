"""A world model for other programs: JSON to be scored, node-link JSON, GraphML, a pose graph."""

import io
import json
from typing import Any

import networkx as nx
import numpy as np

from aprjax.io.pose_graph import PoseGraph, PoseGraphEdge
from aprjax.world.model import WorldModel
from aprjax.world.parts import WorldModelError


def score_json(world: WorldModel) -> str:
    """Nodes, arcs, and the place of every scan of the log; metres and radians.

    Raises `WorldModelError` for a node that is not the place of a scan.
    """
    nodes = [{"id": node, "scan": world.graph.nodes[node]["scan"]} for node in world.nodes]
    for node in nodes:
        if node["scan"] is None:
            raise WorldModelError(f"node {node['id']}: its frame is not that of a scan")
    arcs = [{"a": a.a, "b": a.b, **_pose(a.T_a_b), "kind": a.kind} for a in world.arcs()]
    scans = [
        {"scan": scan, "node": place.node, **_pose(place.T_node_laser)}
        for scan, place in sorted(world.places.items())
    ]
    return json.dumps({"nodes": nodes, "arcs": arcs, "scans": scans}, indent=1) + "\n"


def node_link_json(world: WorldModel) -> str:
    """The graph as networkx reads it, with the appearances of each node at their arcs' ends."""
    graph: Any = nx.Graph()
    for node in world.nodes:
        seen = [
            {"reference": number, **_appearance(world, appearance)}
            for number, appearance in sorted(world.appearances.items())
            if appearance.place.node == node
        ]
        images = [
            {"image_class": appearance.image_class, **_appearance(world, appearance)}
            for _, appearance in sorted(world.images.items())
            if appearance.place.node == node
        ]
        scan = world.graph.nodes[node]["scan"]
        graph.add_node(node, scan=scan, appearances=seen, images=images)
    for arc in world.arcs():
        covariance = np.asarray(arc.covariance).tolist()
        graph.add_edge(arc.a, arc.b, **_arc(arc), covariance=covariance)
    return json.dumps(nx.node_link_data(graph, edges="links"), indent=1) + "\n"


def graphml(world: WorldModel) -> str:
    """The graph with plain attributes."""
    graph: Any = nx.Graph()
    for node in world.nodes:
        scan = world.graph.nodes[node]["scan"]
        count = sum(seen.place.node == node for seen in world.appearances.values())
        graph.add_node(node, scan=-1 if scan is None else scan, references=count)
    for arc in world.arcs():
        graph.add_edge(arc.a, arc.b, **_arc(arc))
    text = io.BytesIO()
    nx.write_graphml_xml(graph, text)
    return text.getvalue().decode()


def pose_graph(world: WorldModel, frame: dict[int, np.ndarray]) -> PoseGraph:
    """The nodes of an assembled `frame`, the first fixed, and the arcs between them."""
    edges = []
    for arc in world.arcs():
        if arc.a in frame:
            # The covariance of an arc is along a's axes, an edge's information along b's.
            cos, sin = np.cos(arc.T_a_b[2]), np.sin(arc.T_a_b[2])
            turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            covariance = turn @ arc.covariance @ turn.T + 1e-12 * np.eye(3)
            information = np.linalg.inv(covariance)
            information = (information + information.T) / 2
            edges.append(PoseGraphEdge(arc.a, arc.b, arc.T_a_b, information))
    return PoseGraph(poses=dict(frame), edges=edges, fixed=[min(frame)])


def _pose(T: np.ndarray) -> dict[str, float]:
    return dict(zip(("x", "y", "theta"), map(float, T), strict=True))


def _arc(arc) -> dict[str, Any]:
    return {"a": arc.a, "b": arc.b, **_pose(arc.T_a_b), "kind": arc.kind, "length": arc.length}


def _appearance(world: WorldModel, appearance) -> dict[str, Any]:
    end = world.arc_end(appearance)
    return {
        "scan": appearance.scan,
        **_pose(appearance.place.T_node_laser),
        "arc_to": end.neighbour,
        "leaving": end.leaving,
    }
