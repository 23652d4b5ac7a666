"""The workloads by name."""

import tempfile
from functools import cache, partial
from pathlib import Path

import jax
import numpy as np

import aprjax
from aprjax.calls import CHUNK
from aprjax.configuration import Packed
from aprjax.describing import describe_chunk
from aprjax.metrics import deviations
from aprjax.sweeping.axes import thresholds
from aprjax.tracking.belief import Situation
from aprjax.world.parts import Appearance, Place
from benchmarks import correlative, fresh, numpy_extraction, numpy_pipeline
from benchmarks.inputs import end_points, some, split, true_pairs
from benchmarks.timing import timed
from benchmarks.tracked import drive
from benchmarks.workload import Metric, Samples, Workload

BATCHES = ("freiburg-079.revisit", "freiburg-079.interleaved", "fhw.revisit", "intel.interleaved")
INTEL, FREIBURG, FHW = "intel.interleaved", "freiburg-079.revisit", "fhw.revisit"
SWEPT = {
    "congruence": ("congruence.tolerance", "congruence.quality.contradiction"),
    "refine": ("refine.gate", "refine.final_gate"),
}
MOST_RUNS = 20  # that a sweep of 64 configurations may cost
CALLS = 1000  # of single queries
FEW = 30  # references, as many as the paper has
MAPPED = 10_000  # references of a large map

PAIR = "µs per scan and reference"
ROUGH, ACCURATE = (0.5, np.radians(10)), (0.2, np.radians(5))  # metres and radians off the truth


def median(tolerance: float) -> tuple[Metric, ...]:
    """The median alone."""
    return (Metric("median", 0.5, tolerance),)


def batch(name: str, quick: bool) -> Samples:
    """All queries of a split against all its references, in one call."""
    scans, references = split(name), _references(name)
    pairs = len(scans.T_world_query) * len(references)
    repeats, warm_up = (2, 1) if quick else (9, 2)
    seconds = timed(lambda _: aprjax.match_batch(scans.queries, references), repeats, warm_up)
    return Samples(1e6 * seconds / pairs, f"{pairs // len(references)} × {len(references)}")


def single(count: int, quick: bool) -> Samples:
    """One query after the other, each another one."""
    queries, references = split(INTEL).queries, _references(INTEL, count)
    each = [some(queries, row) for row in range(len(queries.ranges))]
    calls = CALLS // 10 if quick else CALLS
    seconds = timed(lambda k: aprjax.match(each[k % len(each)], references), calls, warm_up=10)
    return Samples(1e3 * seconds)


def tracking(quick: bool) -> Samples:
    """Step after step of the default tracker; noted how often it then knows where it is."""
    scans = split(INTEL)
    step, situations = drive(scans), []
    calls = 100 if quick else len(scans.T_world_query)
    seconds = timed(lambda k: situations.append(step(k).situation), calls, warm_up=10)
    tracked = situations.count(Situation.TRACKING) / len(situations)
    return Samples(1e3 * seconds, f"tracked in {100 * tracked:.0f} % of the steps")


def extraction(quick: bool) -> Samples:
    """Everything that is computed of a scan by itself."""
    scans = some(split(INTEL).queries, slice(CHUNK))
    described_by = Packed.of(aprjax.FeatureConfig())
    seconds = timed(lambda _: describe_chunk(scans, described_by), 20 if quick else 100)
    return Samples(1e6 * seconds / CHUNK)


def building(quick: bool) -> Samples:
    """A reference set from scans in memory."""
    scans = split(INTEL).references

    def build(_: int) -> jax.Array:
        return aprjax.ReferenceSet.build(scans).index.features.view.xy

    return Samples(1e6 * timed(build, 3 if quick else 15) / len(scans.ranges))


def loading(quick: bool) -> Samples:
    """A map of many references from its file."""
    scans, world = split(INTEL).references, aprjax.WorldModel()
    world.add_node(0)
    taken = [some(scans, row % len(scans.ranges)) for row in range(MAPPED)]
    world.add_references(taken, [Appearance(Place(0, np.zeros(3)), 0)] * MAPPED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map"
        aprjax.save_map(world, path)
        seconds = timed(lambda _: aprjax.load_map(path), 2 if quick else 5, warm_up=1)
    return Samples(seconds, f"{MAPPED} references")


def importing(quick: bool) -> Samples:
    """`import aprjax` in a process that has jax. Files are read before, so the disk is warm."""
    repeats = 2 if quick else 7
    return Samples(np.array([fresh.seconds("import") for _ in range(repeats + 1)][1:]))


def first(what: str, quick: bool) -> Samples:
    """The first call in a fresh process, compilation included."""
    split(fresh.SPLIT)
    return Samples(np.array([fresh.seconds(what) for _ in range(1 if quick else 3)]))


def first_cached(what: str, quick: bool) -> Samples:
    """The same where an earlier process has filled the persistent compilation cache."""
    split(fresh.SPLIT)
    with tempfile.TemporaryDirectory() as folder:
        repeats = 1 if quick else 5
        runs = [fresh.seconds(what, Path(folder) / "cache") for _ in range(repeats + 1)]
    return Samples(np.array(runs[1:]))


def sweep(axes: tuple[str, str], quick: bool) -> Samples:
    """A grid of 64 configurations for all queries of a split; noted as a multiple of one run.

    Raises `RuntimeError` where that is more than `MOST_RUNS`.
    """
    scans, references = split(FHW), _references(FHW)
    known = thresholds(aprjax.MatchConfig())
    values = {name: np.linspace(0.5, 1.5, 8) * known[name] for name in axes}
    config = aprjax.MatchConfig(hypotheses=1)  # as the command `aprjax sweep`
    repeats, warm_up = (1, 1) if quick else (5, 1)
    one = timed(lambda _: aprjax.match_batch(scans.queries, references), 3 * repeats, 2)
    seconds = timed(
        lambda _: aprjax.sweep_grid(scans.queries, references, values, config).quality,
        repeats,
        warm_up,
    )
    runs = float(np.median(seconds) / np.median(one))
    if runs > MOST_RUNS:
        raise RuntimeError(f"64 configurations cost {runs:.1f} runs, more than {MOST_RUNS}")
    return Samples(seconds, f"{runs:.1f} × one run")


def oracle(quick: bool) -> Samples:
    """Pairs of one place by `numpy_pipeline`, the query's extraction apart."""
    scans = split(INTEL)

    def one(reference: int, query: int) -> tuple[float, np.ndarray]:
        known = numpy_extraction.describe(some(scans.references, reference))
        ours = numpy_extraction.describe(some(scans.queries, query))
        found = []
        seconds = timed(lambda _: found.append(numpy_pipeline.match(known, ours)), 1, warm_up=0)
        return seconds[0], found[0][0]

    return _timed_pairs(INTEL, one, 4 if quick else 12, ROUGH)


def correlative_search(quick: bool) -> Samples:
    """Pairs of one place by `correlative`, the reference's raster apart."""
    scans = split(FREIBURG)

    def one(reference: int, query: int) -> tuple[float, np.ndarray]:
        raster = correlative.Raster.of(end_points(some(scans.references, reference)))
        points, found = end_points(some(scans.queries, query)), []
        seconds = timed(lambda _: found.append(correlative.match(raster, points)), 1, warm_up=0)
        return seconds[0], found[0][0]

    return _timed_pairs(FREIBURG, one, 12 if quick else 54, ACCURATE)


WORKLOADS = (
    *(
        Workload(
            f"batch.{name}",
            f"all queries of {name} against all its references, extraction included",
            PAIR,
            median(0.15),
            partial(batch, name),
            cores="all",
        )
        for name in BATCHES
    ),
    *(
        Workload(
            f"single.{count}",
            f"one query at a time against {count} references",
            "ms a call",
            (Metric("median", 0.5, 0.15), Metric("99th percentile", 0.99, 0.5)),
            partial(single, count),
        )
        for count in (FEW, 225)
    ),
    Workload(
        "tracker",
        "one step of the hypothesis tracker, everything included, against 225 references",
        "ms a step",
        (Metric("median", 0.5, 0.15), Metric("99th percentile", 0.99, 0.5)),
        tracking,
    ),
    Workload("extraction", f"features of {CHUNK} scans", "µs per scan", median(0.15), extraction),
    Workload("references", "building a reference set", "µs per scan", median(0.2), building),
    Workload("map.load", "loading a map of many references", "s", median(0.25), loading),
    Workload("import", "import aprjax after import jax", "s", median(0.25), importing),
    *(
        Workload(
            f"first.{what}{suffix}",
            f"{call} in a fresh process{cached}",
            "s",
            median(0.25),
            partial(measure, what),
        )
        for what, call in (("build", f"{FEW} references"), ("match", "the first match"))
        for suffix, cached, measure in (
            ("", ", compilation included", first),
            (".cached", " with a warm compilation cache", first_cached),
        )
    ),
    *(
        Workload(
            f"sweep.{name}",
            f"64 configurations of {' and '.join(axes)} over {FHW}",
            "s",
            median(0.25),
            partial(sweep, axes),
            cores="all",
        )
        for name, axes in SWEPT.items()
    ),
    Workload("numpy.oracle", "the tests' oracles on right pairs", PAIR, median(0.5), oracle),
    Workload(
        "numpy.correlative",
        "multi-resolution correlative scan matching on right pairs",
        PAIR,
        median(0.5),
        correlative_search,
    ),
)


@cache
def _references(name: str, count: int | None = None) -> aprjax.ReferenceSet:
    return aprjax.ReferenceSet.build(some(split(name).references, slice(count)))


def _timed_pairs(name: str, one, count: int, within: tuple[float, float]) -> Samples:
    """`one(reference, query)` gives seconds and a pose; how many poses are right is noted."""
    seconds, right = [], 0
    for reference, query, T_ref_query in true_pairs(split(name), count):
        spent, pose = one(reference, query)
        gap, turn = deviations(pose, T_ref_query)
        right += bool(gap < within[0] and turn < within[1])
        seconds.append(spent)
    degrees = round(float(np.degrees(within[1])))
    note = f"{right} of {count} within {within[0]} m and {degrees}°"
    return Samples(1e6 * np.array(seconds), note)
