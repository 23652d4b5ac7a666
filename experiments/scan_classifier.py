"""The scan classifier on a real log: do a second pass's scans fall into the classes of the place?

`python -m experiments.scan_classifier --out DIR [--track NAME] [--seeds N]`

Growing neural gas of 150 neurons over features of the build run's scans of a track (default:
freiburg-079.revisit); the mapped scans of the track run are sorted into its classes. Prints, for
each seed, the share that falls into a class registered at its place, or a neighbour of one, and
the share of pairs of a mapped scan and a place over 5 m away of which that holds: `here` and `far`
with the classes of all build scans within 1 m and 40° of the place, `nearest` with the one class of
the build scan there. Writes `scan_classifier.csv`, `scan_classifier.png` and `configuration.json`.
True poses (`build.tum`, `track.tum`) only score; see `data.py` for where the logs lie.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.io.trajectory import read_tum
from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import scan_features
from aprjax.places.neural_gas import NeuralGasConfig
from aprjax.places.recognition import recognition
from experiments.data import track_folder
from experiments.outputs import (
    grouped_bars,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)


def main() -> int:
    """Train, classify, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--track", default="freiburg-079.revisit", metavar="NAME")
    parser.add_argument("--seeds", type=int, default=5, metavar="N")
    arguments = parser.parse_args()
    folder = track_folder(arguments.track)
    runs = {
        name: (
            [entry.scan for entry in aprjax.read_log(folder / f"{name}.log.gz")],
            read_tum(folder / f"{name}.tum")[1],
        )
        for name in ("build", "track")
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in range(arguments.seeds):
        classifier = ViewClassifier.train(runs["build"][0], scan_features, seed)
        classes = {name: classifier.classify(scans) for name, (scans, _) in runs.items()}
        result = recognition(
            classifier.gas,
            (runs["build"][1], classes["build"]),
            (runs["track"][1], classes["track"]),
        )
        neurons = int(classifier.gas.alive.sum())
        rows.append({"seed": seed, **dataclasses.asdict(result), "neurons": neurons})
    rows = with_mean(rows)
    print_table(rows)
    write_table(rows, arguments.out / "scan_classifier.csv")
    write_figure(draw(rows), arguments.out / "scan_classifier.png")
    write_configuration(
        arguments.out, track=arguments.track, seeds=list(range(arguments.seeds)),
        gas=dataclasses.asdict(NeuralGasConfig()),
    )  # fmt: skip
    return 0


def with_mean(rows: list[dict]) -> list[dict]:
    """The rows, rounded, and their mean; the first column names them."""
    first, *columns = rows[0]
    mean = {first: "mean", **{name: np.mean([row[name] for row in rows]) for name in columns}}
    return [
        {first: row[first], **{name: round(float(row[name]), 4) for name in columns}}
        for row in [*rows, mean]
    ]


def draw(rows: list[dict]) -> Figure:
    """The shares of each row at the place and far from it."""
    figure = Figure(figsize=(9.5, 0.55 * len(rows) + 1.4), layout="constrained")
    first = next(iter(rows[0]))
    names = [str(row[first]) for row in rows]
    panels = figure.subplots(1, 2, sharey=True)
    kinds = ((panels[0], "", "all views there"), (panels[1], "_nearest", "the nearest view"))
    for ax, suffix, label in kinds:
        found = {
            "at the place": [row[f"here{suffix}"] for row in rows],
            "over 5 m away": [row[f"far{suffix}"] for row in rows],
        }
        grouped_bars(ax, names, found)
        ax.set(xlim=(0, 1.15), xlabel=f"share in the classes of {label}")
    panels[0].set_ylabel(first)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


if __name__ == "__main__":
    sys.exit(main())
