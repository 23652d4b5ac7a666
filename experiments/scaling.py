"""How the time of each stage grows with the number of references, anchors and beams.

    python -m experiments.scaling --out DIR [--quick]

One chunk of queries goes through the matcher's stages, each compiled by itself (see
`benchmarks.stages`), one call after the other: against more and more of the references of
intel.interleaved, with more and more anchors of a scan, and with more and more of the beams of
freiburg-079.interleaved. What does not vary is 60 references and the defaults. All points of one
line are measured in turn, again and again, so that a machine that is slow for a while is so for all
of them. Writes into DIR:

- `scaling.csv`: the median time of a query in each stage, in milliseconds;
- `slopes.csv`: the exponent of its growth, from a straight line through the logarithms: 1 is
  proportional, 0 is constant;
- `scaling.png`: the times, log-log; `configuration.json`.
"""

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.anchors.extract import ExtractionConfig
from benchmarks.stages import stages
from benchmarks.timing import timed
from experiments.data import Split, read_split
from experiments.outputs import (
    BLUE,
    LIGHT,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

REFERENCES, ANCHORS, BEAMS = (15, 30, 60, 120, 225), (8, 12, 16, 24, 32), (60, 90, 180, 360)
FIXED = 60  # references, where something else varies
COLOURS = (BLUE, LIGHT, RED, "#e0903a", "#8a5a00", "#2a8a3e", "#7a3e9d", "#8a8a8a")


def some(scans: aprjax.Scan, count: int, every: int = 1) -> aprjax.Scan:
    """The first scans of a stack, with every which of their beams."""
    scans = jax.tree.map(lambda array: np.asarray(array)[:count], scans)
    return dataclasses.replace(
        scans,
        ranges=scans.ranges[:, ::every],
        beams=-(-scans.beams // every),
        angle_increment=scans.angle_increment * np.float32(every),
    )


def points(quick: bool) -> Iterator[tuple[str, int, aprjax.Scan, aprjax.Scan, int]]:
    """What varies, its value, references, queries, and the most anchors."""
    default = ExtractionConfig().anchors
    chunk = 4 if quick else aprjax.MatchConfig().chunk
    intel: Split = read_split("intel.interleaved")
    queries = some(intel.queries, chunk)
    for count in REFERENCES[:2] if quick else REFERENCES:
        yield "references", count, some(intel.references, count), queries, default
    if quick:
        return
    known = some(intel.references, FIXED)
    for anchors in ANCHORS:
        yield "anchors", anchors, known, queries, anchors
    freiburg = read_split("freiburg-079.interleaved")
    for beams in BEAMS:
        every = BEAMS[-1] // beams
        known, queries = (
            some(freiburg.references, FIXED, every),
            some(freiburg.queries, chunk, every),
        )
        yield "beams", beams, known, queries, default


def compiled(
    references: aprjax.Scan, queries: aprjax.Scan, anchors: int
) -> dict[str, Callable[[], Any]]:
    """Each stage, to be called with what it is given."""
    features = aprjax.FeatureConfig(extraction=ExtractionConfig(anchors=anchors))
    known = aprjax.ReferenceSet.build(references, features)
    return {
        stage.name: partial(stage.compiled, *stage.arguments)
        for stage in stages(queries, known.index, aprjax.MatchConfig())
    }


def measured(works: dict[Any, dict[str, Callable[[], Any]]], repeats: int) -> dict[Any, dict]:
    """Median seconds of the stages at each point, all points taking turns."""
    seconds = {point: {name: [] for name in work} for point, work in works.items()}
    for _ in range(repeats):
        for point, work in works.items():
            for name, run in work.items():
                seconds[point][name] += timed(lambda _: run(), 1).tolist()  # noqa: B023
    return {
        point: {name: float(np.median(times)) for name, times in of.items()}
        for point, of in seconds.items()
    }


def slope(values: list[float], times: list[float]) -> float:
    """The exponent of the power law through the points, by least squares of the logarithms."""
    return float(np.polyfit(np.log(values), np.log(times), 1)[0])


def draw(rows: list[dict], slopes: list[dict]) -> Figure:
    """A panel for each thing that varies."""
    axes = list(dict.fromkeys(row["varies"] for row in rows))
    figure = Figure(figsize=(4.6 * len(axes), 5.2), layout="constrained")
    for ax, varies in zip(figure.subplots(1, len(axes), squeeze=False)[0], axes, strict=True):
        of_stage = {row["stage"]: row["slope"] for row in slopes if row["varies"] == varies}
        for (stage, exponent), colour in zip(of_stage.items(), COLOURS * 2, strict=False):
            mine = [r for r in rows if (r["varies"], r["stage"]) == (varies, stage)]
            last = stage == "all of them"
            ax.loglog(
                [row["value"] for row in mine],
                [row["ms"] for row in mine],
                color="black" if last else colour,
                linewidth=2 if last else 1.2,
                marker="o",
                markersize=3.5,
                label=f"{stage}: {exponent:.2f}",
            )
        ticks = sorted({row["value"] for row in rows if row["varies"] == varies})
        ax.set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
        ax.set_xticks([], minor=True)
        ax.set(xlabel=varies, ylabel="ms a query")
        ax.grid(color="#dddddd", linewidth=0.5)
        ax.legend(
            fontsize=7,
            title="stage: slope",
            title_fontsize=7,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.12),
        )
    return figure


def main() -> int:
    """Measure, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="two numbers of references only")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for varies, line in groupby(points(arguments.quick), key=lambda point: point[0]):
        works, counts = {}, {}
        for _, value, references, queries, anchors in line:
            print(f"{varies}: {value}", file=sys.stderr, flush=True)
            works[value] = compiled(references, queries, anchors)
            counts[value] = len(queries.ranges)
        rows += [
            {
                "varies": varies,
                "value": value,
                "stage": stage,
                "ms": float(f"{1e3 * seconds / counts[value]:.3g}"),
            }
            for value, of in measured(works, 2 if arguments.quick else 9).items()
            for stage, seconds in of.items()
        ]
    slopes = []
    for varies, stage in dict.fromkeys((row["varies"], row["stage"]) for row in rows):
        mine = [row for row in rows if (row["varies"], row["stage"]) == (varies, stage)]
        exponent = slope([row["value"] for row in mine], [row["ms"] for row in mine])
        slopes.append({"varies": varies, "stage": stage, "slope": round(exponent, 3)})
    print_table(slopes)
    write_table(rows, arguments.out / "scaling.csv")
    write_table(slopes, arguments.out / "slopes.csv")
    write_figure(draw(rows, slopes), arguments.out / "scaling.png")
    write_configuration(arguments.out, fixed_references=FIXED, quick=arguments.quick)
    return 0


if __name__ == "__main__":
    sys.exit(main())
