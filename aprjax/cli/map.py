"""`aprjax map`: build a world model from a log, draw it, plan in it, describe and export it."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np

from aprjax.atomic import atomic_write
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import add_laser, add_topic_options, read_drive
from aprjax.cli.outputs import check_output
from aprjax.cli.progress import Progress
from aprjax.io.pose_graph import pose_graph_text
from aprjax.plane import distance
from aprjax.plot.style import figure_of
from aprjax.plot.world import draw_world
from aprjax.world import export
from aprjax.world.build import build_map
from aprjax.world.model import WorldModel
from aprjax.world.parts import WorldModelError
from aprjax.world.planning import PlanError, plan
from aprjax.world.relax import relax
from aprjax.world.store import MapFileError, load_map, save_map
from aprjax.world.super_space import Cycle, assemble, cycles, largest_gap, residuals

_DPI = 130
_POSE_GRAPHS = ("g2o", "toro")
_FORMATS = ("score", "node-link", "graphml", *_POSE_GRAPHS)
_BY_SUFFIX = {
    ".json": "score",
    ".graphml": "graphml",
    ".g2o": "g2o",
    ".graph": "toro",
    ".toro": "toro",
}
_LISTED = 5  # cycles that are spelled out in text


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "map",
        help="build, draw, plan in and export a map",
        description="The hybrid world model: places with local frames, and arcs between them.",
    )
    inner = parser.add_subparsers(title="map commands", required=True, metavar="COMMAND")

    build = inner.add_parser(
        "build",
        help="build a map from a log",
        description="Build a map from a log's scans and raw odometry; recognition closes cycles.",
    )
    build.add_argument("log", type=Path, metavar="LOG", help="a log or bag with odometry")
    build.add_argument("--out", type=Path, required=True, metavar="MAP", help="the map to write")
    build.add_argument(
        "--strict", action="store_true", help="stop at a damaged line instead of skipping it"
    )
    add_laser(build)
    add_topic_options(build, odometry=True)
    build.set_defaults(run=_build)

    show = inner.add_parser("show", help="draw a map", description="Draw a map as a picture.")
    _add_map(show)
    show.add_argument("--out", type=Path, required=True, metavar="F.png", help="PNG to write")
    _add_frame(show)
    show.add_argument("--no-scans", action="store_true", help="do not draw the reference scans")
    show.set_defaults(run=_show)

    path = inner.add_parser(
        "path", help="plan a way", description="Print the shortest way between two nodes."
    )
    _add_map(path)
    path.add_argument("start", type=int, metavar="A", help="node to start from")
    path.add_argument("goal", type=int, metavar="B", help="node to go to")
    path.set_defaults(run=_path)

    info = inner.add_parser(
        "info", help="describe a map", description="Say what a map holds and where it is torn."
    )
    _add_map(info)
    info.add_argument("--json", action="store_true", help="print one JSON object")
    info.set_defaults(run=_info)

    exporting = inner.add_parser(
        "export",
        help="write a map for other programs",
        description="Write the graph and the place of every scan as JSON (score), the graph as "
        "node-link JSON or GraphML, or its poses as a pose graph, g2o or TORO; --relaxed and "
        "--root are for pose graphs.",
    )
    _add_map(exporting)
    exporting.add_argument("--out", type=Path, required=True, metavar="F", help="file to write")
    exporting.add_argument(
        "--format",
        choices=_FORMATS,
        help=f"default: by the file's suffix, {' '.join(_BY_SUFFIX)}",
    )
    _add_frame(exporting)
    exporting.set_defaults(run=_export)


def _add_map(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("map", type=Path, metavar="MAP", help="a map that `map build` wrote")


def _add_frame(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--relaxed",
        action="store_true",
        help="spread the contradictions of the cycles over the arcs",
    )
    parser.add_argument(
        "--root",
        type=int,
        metavar="NODE",
        help="node whose frame the others are assembled into (default: the first)",
    )


def _build(arguments: argparse.Namespace) -> None:
    check_output(arguments.out, arguments.log)
    entries = read_drive(arguments)
    start = time.monotonic()
    with Progress("building", 2 * len(entries)) as progress:
        world = build_map(entries, progress=progress.advance)
    save_map(world, arguments.out)
    found = cycles(world)
    closed = "no cycle"
    if found:
        closed = f"cycles: {len(found)}, the worst misses its start by {largest_gap(found):.2f} m"
    print(
        f"{len(entries)} scans: {len(world.nodes)} nodes, {world.graph.number_of_edges()} arcs, "
        f"{len(world.appearances)} references, {closed}; {time.monotonic() - start:.1f} s",
        file=sys.stderr,
    )


def _show(arguments: argparse.Namespace) -> None:
    check_output(arguments.out, arguments.map)
    world = open_map(arguments.map)
    frame = _frame(world, arguments)
    figure = figure_of(draw_world(world, frame, scans=not arguments.no_scans))
    with atomic_write(arguments.out, "wb") as file:
        figure.savefig(file, format="png", dpi=_DPI)
    warn_of_parts(arguments.map, "nodes", world.nodes, frame)


def _path(arguments: argparse.Namespace) -> None:
    world = open_map(arguments.map)
    try:
        way = plan(world, arguments.start, arguments.goal)
    except PlanError as error:
        raise CommandError(f"{arguments.map}: {error}") from None
    print("from,to,length_m,turn_deg,kind")
    for leg in way.legs:
        turn = np.degrees(leg.turn)
        print(f"{leg.start},{leg.end},{leg.length:.3f},{turn:.1f},{leg.kind}")
    print(f"{len(way.legs)} arcs, {way.length:.2f} m", file=sys.stderr)


def _info(arguments: argparse.Namespace) -> None:
    facts = map_facts(open_map(arguments.map))
    if arguments.json:
        print(json.dumps(facts, indent=2))
        return
    listed = facts.pop("cycle_residuals")
    for key, value in facts.items():
        print(f"{key.replace('_', ' ')}: {value}")
    if len(listed) > _LISTED:
        print(f"the worst {_LISTED} of {len(listed)} cycles:")
    for cycle in listed[:_LISTED]:
        print(
            f"cycle {'-'.join(map(str, cycle['nodes']))}: {cycle['length_m']} m, misses its start "
            f"by {cycle['gap_m']} m and {cycle['gap_deg']}°{', torn' if cycle['torn'] else ''}; "
            f"relaxed, an arc of it is off by {cycle['worst_arc_relaxed_m']} m and "
            f"{cycle['worst_arc_relaxed_deg']}° at most"
        )


def map_facts(world: WorldModel) -> dict[str, Any]:
    """What a map holds, in numbers, and all its cycles, the worst first.

    A cycle's residual is all at its end before relaxation (`gap`), and spread over its arcs after
    it, of which the one that is farthest off is told.
    """
    found = sorted(cycles(world), key=lambda cycle: -float(distance(cycle.T_residual)))
    arcs = list(world.arcs())
    parts = [min(part) for part in nx.connected_components(world.graph)]
    # The frames of different parts have no arc in common, and may lie over each other.
    assembled, relaxed = (
        residuals(world, {node: T for part in parts for node, T in frame(world, part).items()})
        for frame in (assemble, relax)
    )
    left = {frozenset((arc.a, arc.b)): off for arc, off in zip(arcs, relaxed, strict=True)}
    return {
        "nodes": len(world.nodes),
        "parts": len(parts),
        "arcs": len(arcs),
        "arcs_closed": sum(arc.kind == "closed" for arc in arcs),
        "length_m": round(sum(arc.length for arc in arcs), 1),
        "references": len(world.appearances),
        "image_classes": len({image.image_class for image in world.images.values()}),
        "scans_placed": len(world.places),
        "cycles": len(found),
        "cycles_torn": sum(cycle.torn for cycle in found),
        "worst_arc_assembled_m": _worst(assembled),
        "worst_arc_relaxed_m": _worst(relaxed),
        "cycle_residuals": [_cycle_facts(cycle, left) for cycle in found],
    }


def _cycle_facts(cycle: Cycle, left: dict[frozenset[int], np.ndarray]) -> dict[str, Any]:
    """`left` holds by how much `(3,)` each arc is off in the relaxed frame, by its two nodes."""
    around = pairwise((*cycle.nodes, cycle.nodes[0]))
    off = np.array([left[frozenset(ends)] for ends in around])
    return {
        "nodes": list(cycle.nodes),
        "length_m": round(cycle.length, 1),
        "gap_m": round(float(distance(cycle.T_residual)), 3),
        "gap_deg": _degrees(cycle.T_residual[2]),
        "torn": cycle.torn,
        "worst_arc_relaxed_m": _worst(off),
        "worst_arc_relaxed_deg": _degrees(np.abs(off[:, 2]).max()),
    }


def _worst(off: np.ndarray) -> float:
    """Metres by which the worst arc does not fit a frame."""
    return round(float(distance(off).max()), 3) if len(off) else 0.0


def _degrees(angle: float) -> float:
    return round(float(np.degrees(abs(angle))), 2)


def _export(arguments: argparse.Namespace) -> None:
    chosen = arguments.format or _BY_SUFFIX.get(arguments.out.suffix)
    if chosen is None:
        raise CommandError(f"{arguments.out}: say --format, one of {', '.join(_FORMATS)}")
    if chosen not in _POSE_GRAPHS and (arguments.relaxed or arguments.root is not None):
        option = "--relaxed" if arguments.relaxed else "--root"
        raise CommandError(f"{arguments.out}: {chosen} has no frame of all nodes for {option}")
    check_output(arguments.out, arguments.map)
    world = open_map(arguments.map)
    frame = _frame(world, arguments) if chosen in _POSE_GRAPHS else None
    try:
        if frame is not None:
            text = pose_graph_text(export.pose_graph(world, frame), chosen)
        else:
            writers = {
                "score": export.score_json,
                "node-link": export.node_link_json,
                "graphml": export.graphml,
            }
            text = writers[chosen](world)
    except WorldModelError as error:
        raise CommandError(f"{arguments.map}: {error}") from None
    with atomic_write(arguments.out) as file:
        file.write(text)
    if frame is not None:
        warn_of_parts(arguments.map, "nodes", world.nodes, frame)


def _frame(world: WorldModel, arguments: argparse.Namespace) -> dict[int, np.ndarray]:
    """The frame that is asked for."""
    try:
        return (relax if arguments.relaxed else assemble)(world, arguments.root)
    except WorldModelError as error:
        raise CommandError(f"{arguments.map}: {error}") from None


def warn_of_parts(
    path: Path, what: str, nodes: Sequence[int], frame: dict[int, np.ndarray]
) -> None:
    """Say on standard error how many of what is at these `nodes` an assembled frame cannot hold."""
    left_out = sum(node not in frame for node in nodes)
    if left_out:
        print(
            f"{path}: {left_out} of {len(nodes)} {what} left out: no arcs lead there from node "
            f"{next(iter(frame))}",
            file=sys.stderr,
        )


def open_map(path: Path) -> WorldModel:
    """A saved map."""
    try:
        return load_map(path)
    except MapFileError as error:
        raise CommandError(str(error)) from None
