"""A world model as other programs read it: JSON to be scored, node-link JSON, GraphML, g2o."""

import io
import json
from typing import Any

import networkx as nx
import numpy as np

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


def g2o(world: WorldModel, frame: dict[int, np.ndarray]) -> str:
    """A pose graph: the nodes of an assembled `frame`, and the arcs between them."""
    lines = []
    for node in sorted(frame):
        x, y, theta = frame[node]
        lines.append(f"VERTEX_SE2 {node} {x:.9f} {y:.9f} {theta:.9f}")
    lines.append(f"FIX {min(frame)}")
    for arc in world.arcs():
        if arc.a in frame:
            information = np.linalg.inv(arc.covariance + 1e-12 * np.eye(3))
            upper = " ".join(f"{value:.9g}" for value in information[np.triu_indices(3)])
            x, y, theta = arc.T_a_b
            lines.append(f"EDGE_SE2 {arc.a} {arc.b} {x:.9f} {y:.9f} {theta:.9f} {upper}")
    return "\n".join(lines) + "\n"


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
