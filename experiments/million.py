"""A million references: which of them are worth a look, and what a query costs.

    python -m experiments.million --out DIR [--references N] [--quick]

Simulated office floors, of which a robot took 100 scans of 181 beams each, at random places and
with random headings (180°, noise 1 cm). A query is taken later, up to a metre and 30° off one of
them, when a quarter of doors and furniture stand elsewhere. A reference is right that was taken
within 2 m and 40° of the query on its floor.

Each query ranks the references of its own floor and of more and more others, by the paper's q_m
and by the signature of `aprjax.evaluation` that succeeds it. Then queries are matched with the
catalogue of all. Floors are made, and their scans taken, some at a time, by processes of their own
(not with --quick); that is not timed. Writes into DIR:

- `recall.csv`: the share of the queries with a right reference among the first 64, over the number
  of references, q_m up to 100 000 of them; `recall.png` draws it;
- `costs.csv` (not with --quick): references inserted in a second, milliseconds of a query in a
  batch of 256 (median of three batches), the most memory that the process took, those that make
  floors apart, and how many of the queries were answered rightly (within 0.5 m and 10°), wrongly
  and not at all;
- `configuration.json`.

100 000 references by default, with --quick 1000.
"""

import argparse
import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.metrics import is_near, is_right
from aprjax.numerics import bucket
from aprjax.plane import relative
from aprjax.relations.histograms import EdgeHistogram, count_correspondences
from aprjax.sim.floor_plan import FloorPlan, office
from aprjax.sim.ray_casting import cast
from aprjax.sim.routes import point_in
from aprjax.sim.world import World
from experiments.outputs import (
    BLUE,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

EACH = 100  # references of a floor
ASKED = 20  # queries of a floor, as long as there are to be more
QUERIES = 512
AT_ONCE = 20  # floors made at a time
FIRST = 64
REPEATS = 3  # of the batch that is timed
COUNTED = 100_000  # references up to which q_m is measured: there it finds few right ones
OFF_DISTANCE, OFF_ANGLE = 1.0, np.radians(30)  # of a query from a reference
CLUTTER, REARRANGED, NOISE = 0.3, 0.25, 0.01
BEARINGS = np.radians(np.arange(181.0) - 90).astype(np.float32)
COLOURS = {"q_m": BLUE, "signature": RED}


@dataclass(frozen=True)
class Floors:
    """Some floors with their scans, and later ones from beside some of them."""

    floor: np.ndarray
    """`(references,)`: the number of each one's floor."""
    T_floor_ref: np.ndarray
    """`(references, 3)`."""
    references: aprjax.Scan
    query_floor: np.ndarray
    T_floor_query: np.ndarray
    queries: aprjax.Scan | None
    """None where none are asked for."""


def floors(numbers: range, asked: int, over: Callable[..., Iterable] = map) -> Floors:
    """These floors, each the same whichever others are made, with so many queries of each.

    `over` maps a function over the floors: `map` here, an executor's in other processes.
    """
    made = list(over(partial(one_floor, asked=asked), numbers))
    poses, queries = (np.concatenate([each[k] for each in made]) for k in (0, 2))
    return Floors(
        floor=np.repeat(numbers, EACH),
        T_floor_ref=poses,
        references=stack(np.concatenate([each[1] for each in made])),
        query_floor=np.repeat(numbers, asked),
        T_floor_query=queries,
        queries=stack(np.concatenate([each[3] for each in made])) if asked else None,
    )


def makers() -> ProcessPoolExecutor:
    """Processes that make floors, one for each core: furnishing is Python's work.

    They keep off an accelerator, which the first process has for itself. They are spawned: forked,
    they would lack JAX's threads.
    """
    return ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=_on_cpu)


def _on_cpu() -> None:
    jax.config.update("jax_platforms", "cpu")


def one_floor(number: int, asked: int) -> tuple[np.ndarray, ...]:
    """Poses and ranges of a floor's references and queries."""
    rng = np.random.default_rng(number)
    plan = office(number, clutter=CLUTTER, visited=99)
    areas: list[np.ndarray] = [plan.areas.nodes[node]["rectangle"] for node in plan.areas]
    size = np.array([np.prod(area[1] - area[0]) for area in areas])
    where = rng.choice(len(areas), EACH, p=size / size.sum())
    poses = np.array([[*point_in(rng, areas[k]), rng.uniform(-np.pi, np.pi)] for k in where])
    beside = rng.choice(EACH, asked, replace=False)
    later = plan.rearranged(number, REARRANGED)
    queries = np.array([_beside(rng, poses[k], areas[where[k]]) for k in beside]).reshape(-1, 3)
    return poses, _ranges(rng, plan, poses), queries, _ranges(rng, later, queries)


def _beside(rng: np.random.Generator, pose: np.ndarray, area: np.ndarray) -> np.ndarray:
    """A pose not far from another one in its area, a convex one."""
    way, distance = rng.uniform(-np.pi, np.pi), OFF_DISTANCE * np.sqrt(rng.uniform())
    xy = pose[:2] + distance * np.array([np.cos(way), np.sin(way)])
    return np.array([*np.clip(xy, *area), pose[2] + rng.uniform(-OFF_ANGLE, OFF_ANGLE)])


def _ranges(rng: np.random.Generator, plan: FloorPlan, poses: np.ndarray) -> np.ndarray:
    """Ranges `(poses, beams)` in metres."""
    world = plan.world()
    world = world.pad(bucket(len(world.segments), 256), bucket(len(world.circles), 64))
    count = len(poses)
    padded = np.pad(poses, [(0, -count % ASKED), (0, 0)]).astype(np.float32)
    depth = np.asarray(_cast(world, padded))[:count]
    return depth + rng.normal(0.0, NOISE, depth.shape)


@jax.jit
def _cast(world: World, poses: jax.Array) -> jax.Array:
    return jax.lax.map(lambda pose: cast(world, pose, jax.numpy.asarray(BEARINGS)), poses)


def stack(ranges: np.ndarray) -> aprjax.Scan:
    """Stacked scans of ranges `(scans, beams)`."""
    one = aprjax.Scan.make(
        ranges[0], angle_min=BEARINGS[0], angle_increment=np.radians(1.0), range_max=30.0
    )
    count = len(ranges)
    stacked = jax.tree.map(lambda array: np.broadcast_to(array, (count, *np.shape(array))), one)
    stacked = aprjax.Scan(**(vars(stacked) | {"ranges": ranges.astype(np.float32)}))
    return stacked.pad(bucket(ranges.shape[1], smallest=64))


class Ranking:
    """How many references come before the best right one of each query."""

    def __init__(self, queries: int) -> None:
        self.best = np.full(queries, -np.inf)
        self.before = np.zeros(queries, int)

    def own(self, scores: np.ndarray, right: np.ndarray, same: np.ndarray) -> None:
        """The references of the queries' floors, `same` for the pairs on one."""
        self.best = np.max(np.where(right, scores, -np.inf), axis=1)
        self.before = np.sum(self._better(scores) & same & ~right, axis=1)

    def others(self, scores: np.ndarray, same: np.ndarray) -> None:
        """Some more references; those on the query's own floor are counted already."""
        self.before += np.sum(self._better(scores) & ~same, axis=1)

    def _better(self, scores: np.ndarray) -> np.ndarray:
        """Equals come before: a measure that tells nothing gets nothing for it."""
        return scores >= self.best[:, None]

    @property
    def recall(self) -> float:
        """The share of the queries with a right one among the first."""
        return float(np.mean(self.before < FIRST))


class Measures:
    """q_m and the likeness of signatures of all queries with the references added last."""

    def __init__(self, catalogue: aprjax.Catalogue, queries: aprjax.Scan) -> None:
        self.config = catalogue.config
        self.signatures = catalogue.signatures(queries)
        self.histogram = self._histogram(queries)

    def _histogram(self, scans: aprjax.Scan) -> EdgeHistogram:
        index = aprjax.ReferenceSet.build(scans, self.config).index
        count = len(scans.ranges)
        return jax.tree.map(lambda array: np.asarray(array)[:count], index.features.histogram)

    def of(self, references: aprjax.Scan, catalogue: aprjax.Catalogue) -> dict[str, np.ndarray]:
        """`(queries, references)` each; q_m only as long as the catalogue is not too large."""
        last = [np.asarray(block.signatures)[: len(block)] for block in catalogue.blocks[-2:]]
        signatures = np.concatenate(last)[-len(references.ranges) :]
        scores = {"signature": self.signatures @ signatures.T}
        if len(catalogue) <= COUNTED:
            mine, theirs = self.histogram, self._histogram(references)
            count = _counted(mine, theirs, self.config.relation)
            edges = np.maximum(mine.edges[:, None] * theirs.edges[None, :], 1.0)
            scores["q_m"] = np.asarray(count) ** 2 / edges
        return scores


_counted = jax.jit(count_correspondences)


def groups(total: int) -> Iterator[range]:
    """Numbers of the floors that are made at a time."""
    for start in range(0, total, AT_ONCE):
        yield range(start, min(start + AT_ONCE, total))


def measured(
    total: int, queries: int, over: Callable[..., Iterable] = map
) -> tuple[list[dict], aprjax.Catalogue, float, Floors]:
    """The table of recalls; the catalogue of all, seconds of inserting them, and the queries."""
    asking = -(-queries // ASKED)
    first = floors(range(asking), ASKED, over)
    assert first.queries is not None
    same = first.query_floor[:, None] == first.floor[None, :]
    right = same & is_near(first.T_floor_ref[None], first.T_floor_query[:, None])

    catalogue = aprjax.Catalogue.build(jax.tree.map(lambda a: a[:1], first.references))
    catalogue = aprjax.Catalogue(catalogue.slots, catalogue.config)
    measures = Measures(catalogue, first.queries)
    rankings = {measure: Ranking(len(same)) for measure in COLOURS}
    for measure, scores in measures.of(first.references, catalogue.add(first.references)).items():
        rankings[measure].own(scores, right, same)
    rows, seconds = [], 0.0
    sizes = [EACH * 10**k for k in range(9)]
    rows += _recalls(rankings, EACH)
    for numbers in _upto(groups(total // EACH), [size // EACH for size in sizes]):
        here = floors(numbers, 0, over)
        began = time.perf_counter()
        catalogue = catalogue.add(here.references)
        jax.block_until_ready(catalogue.blocks[-1].signatures)
        seconds += time.perf_counter() - began
        for measure, scores in measures.of(here.references, catalogue).items():
            rankings[measure].others(scores, first.query_floor[:, None] == here.floor[None, :])
        count = EACH * numbers.stop
        if count in sizes[1:] or count == total:
            known = rankings if count <= COUNTED else {"signature": rankings["signature"]}
            rows += _recalls(known, count)
            print(f"{count} references", file=sys.stderr, flush=True)
    return rows, catalogue, seconds, first


def _upto(parts: Iterator[range], ends: list[int]) -> Iterator[range]:
    """The same numbers, divided also at `ends`."""
    for part in parts:
        inner = [end for end in ends if part.start < end < part.stop]
        for low, high in zip([part.start, *inner], [*inner, part.stop], strict=True):
            yield range(low, high)


def _recalls(rankings: dict[str, Ranking], references: int) -> list[dict]:
    return [
        {
            "references": references,
            "measure": measure,
            "queries": len(ranking.before),
            f"first_{FIRST}": round(ranking.recall, 4),
        }
        for measure, ranking in rankings.items()
    ]


def costs(catalogue: aprjax.Catalogue, seconds: float, asked: Floors) -> dict:
    """A row of the table."""
    chosen = np.flatnonzero(asked.query_floor * EACH < len(catalogue))[:256]
    queries = jax.tree.map(lambda array: np.asarray(array)[chosen], asked.queries)
    match = partial(aprjax.match_catalogue, queries, catalogue)
    result = match()
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        match()
        times.append(time.perf_counter() - began)
    took = float(np.median(times))
    reference = result.reference[:, 0]
    own = asked.query_floor[chosen] == np.maximum(reference, 0) // EACH
    T_floor_ref = asked.T_floor_ref[np.where(own, reference, 0)]
    truth = relative(T_floor_ref, asked.T_floor_query[chosen])
    right = own & is_right(np.asarray(result.T_ref_query[:, 0]), truth) & result.confident
    return {
        "references": len(catalogue),
        "inserted_per_s": round(len(catalogue) / seconds),
        "ms_per_query": round(1e3 * took / len(chosen), 2),
        "GB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 2),
        "queries": len(chosen),
        "right": int(right.sum()),
        "wrong": int((result.confident & ~right).sum()),
        "none": int((~result.confident).sum()),
    }


def draw(rows: list[dict]) -> Figure:
    """Recall over the number of references."""
    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    ax = figure.subplots()
    for measure, colour in COLOURS.items():
        mine = [row for row in rows if row["measure"] == measure]
        ax.semilogx(
            [row["references"] for row in mine],
            [row[f"first_{FIRST}"] for row in mine],
            color=colour,
            marker="o",
            markersize=4,
            label=measure,
        )
    ax.set(xlabel="references", ylabel=f"share with a right one among the first {FIRST}")
    ax.set_ylim(-0.03, 1.03)
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.legend(loc="lower left", frameon=False)
    return figure


def main() -> int:
    """Measure, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--references", type=int, default=100_000, metavar="N")
    parser.add_argument("--quick", action="store_true", help="1000 references, and no matching")
    arguments = parser.parse_args()
    total, queries = (1000, 40) if arguments.quick else (arguments.references, QUERIES)
    if total < EACH or total % EACH:
        parser.error(f"--references: {total} is no multiple of {EACH}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.quick:
        rows, catalogue, seconds, asked = measured(total, queries)
    else:
        with makers() as pool:
            rows, catalogue, seconds, asked = measured(total, queries, pool.map)
    print_table(rows)
    write_table(rows, arguments.out / "recall.csv")
    write_figure(draw(rows), arguments.out / "recall.png")
    if not arguments.quick:
        table = [costs(catalogue, seconds, asked)]
        print_table(table)
        write_table(table, arguments.out / "costs.csv")
    write_configuration(arguments.out, references=total, queries=queries)
    return 0


if __name__ == "__main__":
    sys.exit(main())
