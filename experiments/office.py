"""A large office in simulation: does the graph that is built have the office's topology?

    python -m experiments.office --out DIR [--quick]

The paper's second experiment as data: corridors of 50 × 70 m with five cycles, niches and open
rooms on both sides, other ones for each seed. A robot drives in them, in one direction through
each, until it has been everywhere twice; its wheels' odometry is off by 10 % of the way and the
turns. The map that is built from the scans and that odometry, by the defaults, is compared with
the corridors: both graphs without their nodes of degree two must be isomorphic. Writes into DIR:

- `office.csv`: a row for each seed: same_topology; cycles; false_arcs and the other figures of
  `map_scores.score_map`; rms_m of the relaxed frame; odometry_m, by how much odometry misses the
  end.
- `office-SEED.png`: the relaxed frame.
- `configuration.json`: the defaults that made them.

With --quick one cycle of the office, driven round twice, and one seed.
"""

import argparse
import sys
from itertools import pairwise
from pathlib import Path

import jax
import networkx as nx
import numpy as np

from aprjax.configuration import to_dict
from aprjax.plane import distance, relative, wrap
from aprjax.plot.style import figure_of
from aprjax.plot.world import draw_world
from aprjax.sim.laser import Laser, take_scans
from aprjax.sim.odometry import OdometryConfig, odometry
from aprjax.sim.world import World
from aprjax.world.build import MapConfig, build_from_scans
from aprjax.world.model import WorldModel
from aprjax.world.relax import relax
from experiments.map_scores import frame_rms, score_map
from experiments.outputs import print_table, write_configuration, write_figure, write_table

SEEDS = (0, 1, 2, 3, 4)
ERROR = 0.1  # of the way and of the turns
STEP, TURN = 0.8, 1.5  # metres between scans, and metres that a radian counts in it
WIDTH = 2.4  # metres of a corridor
CUT = 0.8  # metres before a corner from where the robot turns
JUNCTIONS = {  # metres
    **{0: (0, 0), 1: (22, 0), 2: (50, 0), 3: (50, 30), 4: (50, 70), 5: (22, 70)},
    **{6: (0, 70), 7: (0, 48), 8: (22, 48), 9: (22, 30), 10: (0, 30)},
}
CORRIDORS = (  # in the direction in which they are driven
    *((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7), (7, 10), (10, 0)),
    *((9, 1), (9, 3), (8, 9), (7, 8), (5, 8), (10, 9)),
)
SMALL = ((0, 1), (1, 9), (9, 10), (10, 0))


def corridors(quick: bool) -> nx.DiGraph:
    """The true topology, with the junctions' places `xy`."""
    graph = nx.DiGraph()
    graph.add_edges_from(SMALL if quick else CORRIDORS)
    nx.set_node_attributes(graph, {n: np.array(JUNCTIONS[n], float) for n in graph}, "xy")
    return graph


def walls(seed: int, graph: nx.DiGraph) -> np.ndarray:
    """The faces of all walls, `(S, 2, 2)`: corridors with niches and rooms on both sides."""
    rng = np.random.default_rng(seed)
    free = []
    for a, b in graph.edges:
        ends = np.array([graph.nodes[a]["xy"], graph.nodes[b]["xy"]])
        low, high = ends.min(axis=0), ends.max(axis=0)
        free.append(np.array([low - WIDTH / 2, high + WIDTH / 2]))
        along = int(np.argmax(high - low))
        for side in (-1, 1):
            at = low[along] + WIDTH / 2 + rng.uniform(0.3, 2.0)
            while at < high[along] - WIDTH / 2 - 1.5:
                width = rng.uniform(0.4, 1.6)
                # Doors stand open here and there.
                depth = rng.uniform(2.0, 4.0) if rng.random() < 0.2 else rng.uniform(0.15, 0.7)
                niche = np.empty((2, 2))
                niche[:, along] = at, at + min(width, high[along] - WIDTH / 2 - 0.2 - at)
                face = low[1 - along] + side * WIDTH / 2
                niche[:, 1 - along] = sorted((face, face + side * depth))
                free.append(niche)
                at += width + rng.uniform(0.4, 3.5)
    return outline(np.array(free))


def outline(rectangles: np.ndarray) -> np.ndarray:
    """The boundary `(S, 2, 2)` of the union of `rectangles` `(R, 2, 2)`, low and high corners."""
    xs, ys = (np.unique(rectangles[:, :, axis]) for axis in (0, 1))
    inside = np.zeros((len(xs) + 1, len(ys) + 1), bool)  # cells between them, with a margin
    for (left, low), (right, high) in rectangles:
        columns = slice(np.searchsorted(xs, left) + 1, np.searchsorted(xs, right) + 1)
        inside[columns, np.searchsorted(ys, low) + 1 : np.searchsorted(ys, high) + 1] = True
    upright = [
        [(xs[column], ys[start]), (xs[column], ys[end])]
        for column, start, end in _runs(inside[1:, 1:-1] != inside[:-1, 1:-1])
    ]
    level = [
        [(xs[start], ys[row]), (xs[end], ys[row])]
        for row, start, end in _runs((inside[1:-1, 1:] != inside[1:-1, :-1]).T)
    ]
    return np.array(upright + level)


def _runs(faces: np.ndarray) -> list[tuple[int, int, int]]:
    """Row, start and end of each run of `faces` `(lines, cells)`."""
    padded = np.pad(faces, [(0, 0), (1, 1)]).astype(int)
    line, start = np.nonzero(np.diff(padded) == 1)
    _, end = np.nonzero(np.diff(padded) == -1)
    return list(zip(line.tolist(), start.tolist(), end.tolist(), strict=True))


def way(seed: int, graph: nx.DiGraph) -> list[int]:
    """The junctions that the robot passes, until it took each turn and is back in a corridor."""
    rng = np.random.default_rng(seed)
    turns = {(a, b, c): 0 for a, b in graph.edges for c in graph.successors(b)}
    passed = list(next(iter(graph.edges)))
    once = 1 if len(turns) > len(SMALL) else 2  # where all turns are those of one ring
    while min(turns.values()) < once:
        at = nx.DiGraph()
        for a, b, c in turns:
            at.add_edge((a, b), (b, c), cost=0.01 + turns[a, b, c] + 0.1 * rng.random())
        rarest = min(turns, key=lambda turn: (turns[turn], turn))
        here = passed[-2], passed[-1]
        legs = [*nx.shortest_path(at, here, rarest[:2], weight="cost"), rarest[1:]]
        for (a, b), (_, c) in pairwise(legs):
            turns[a, b, c] += 1
            passed.append(c)
    return passed


def poses(seed: int, graph: nx.DiGraph, passed: list[int]) -> np.ndarray:
    """The robot's poses `(N, 3)` along a way, with corners cut."""
    rng = np.random.default_rng(seed)
    points = [graph.nodes[passed[0]]["xy"]]
    for a, b, c in zip(passed[:-2], passed[1:-1], passed[2:], strict=True):
        corner = graph.nodes[b]["xy"]
        before, after = (v / np.linalg.norm(v) for v in _legs(graph, a, b, c))
        bend = np.linspace(0, 1, 12)[:, None]
        start, end = corner - CUT * before, corner + CUT * after
        points += list((1 - bend) ** 2 * start + 2 * bend * (1 - bend) * corner + bend**2 * end)
    points.append(graph.nodes[passed[-1]]["xy"])
    xy = np.array(points)
    xy = xy[np.append(True, np.linalg.norm(np.diff(xy, axis=0), axis=1) > 1e-6)]
    driven = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1)))
    steps = np.diff(xy, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middle = (driven[1:] + driven[:-1]) / 2
    turned = np.interp(driven, middle, np.append(0.0, np.cumsum(np.abs(np.diff(heading)))))
    spent = driven + TURN * turned
    at = np.interp(np.arange(0.0, spent[-1], STEP), spent, driven)
    # It keeps to no line exactly.
    sway = 0.25 * np.sin(at / rng.uniform(4, 6) + rng.uniform(0, 6))
    theta = np.interp(at, middle, heading) + 0.05 * np.cos(at / 2.3)
    place = np.stack([np.interp(at, driven, column) for column in xy.T], axis=-1)
    place += sway[:, None] * np.stack([-np.sin(theta), np.cos(theta)], axis=-1)
    return np.concatenate([place, wrap(theta)[:, None]], axis=1)


def _legs(graph: nx.DiGraph, *nodes: int) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (graph.nodes[node]["xy"] for node in nodes)
    return b - a, c - b


def contracted(graph: nx.Graph) -> nx.MultiGraph:
    """A graph without its nodes of degree two, and without dead ends, which a drive leaves."""
    left = nx.MultiGraph(graph)
    while ends := [node for node, degree in left.degree() if degree == 1]:
        left.remove_nodes_from(ends)
    for node in list(left):
        if left.degree(node) == 2 and not left.has_edge(node, node):
            a, b = (other for _, other in left.edges(node))
            left.remove_node(node)
            left.add_edge(a, b)
    return left


def run(seed: int, quick: bool) -> tuple[dict, WorldModel]:
    """A row of the table, and the map."""
    print(f"seed {seed}: building", file=sys.stderr, flush=True)
    graph = corridors(quick)
    truth = poses(seed, graph, way(seed, graph))
    surroundings = World.make(walls(seed, graph))
    stacked = take_scans(jax.random.key(seed), Laser.sick(), surroundings, None, truth)
    scans = [jax.tree.map(lambda array, k=k: array[k], stacked) for k in range(len(truth))]
    errors = OdometryConfig(scale=ERROR, turn_scale=ERROR, slip=ERROR, turning=ERROR)  # pyright: ignore[reportArgumentType]
    wheels, _ = odometry(seed, truth, np.arange(len(truth), dtype=float), errors)
    world = build_from_scans(scans, wheels)
    scores = score_map(world, truth)
    off = relative(relative(truth[0], truth[-1]), relative(wheels[0], wheels[-1]))
    same = nx.is_isomorphic(contracted(world.graph), contracted(graph.to_undirected()))
    row = {
        "seed": seed,
        "scans": len(truth),
        "same_topology": bool(same),
        "cycles": world.graph.number_of_edges() - len(world.nodes) + 1,
        **{key: scores[key] for key in ("nodes", "references", "arcs", "closed", "false_arcs")},
        "recognized": round(scores["recognized"], 3),
        "arc_m": round(scores["arc_m"], 4),
        "arc_deg": round(scores["arc_deg"], 2),
        "rms_m": round(frame_rms(world, relax(world), truth), 3),
        "odometry_m": round(float(distance(off)), 1),
    }
    return row, world


def main() -> int:
    """Drive, build, compare, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seeds", nargs="*", type=int, help="default: five")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="one cycle and one seed")
    arguments = parser.parse_args()
    seeds = arguments.seeds or (SEEDS[:1] if arguments.quick else SEEDS)
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in seeds:
        row, world = run(seed, arguments.quick)
        rows.append(row)
        drawn = draw_world(world, relax(world))
        write_figure(figure_of(drawn), arguments.out / f"office-{seed}.png", dpi=130)
        write_table(rows, arguments.out / "office.csv")
    print_table(rows)
    write_configuration(arguments.out, seeds=list(seeds), map=to_dict(MapConfig()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
