"""The scan classifier on a real log: do a second pass's scans fall into the classes of the place?

`python experiments/scan_classifier.py [--track NAME] [--seeds N]`

Growing neural gas of 150 neurons over features of the build run's scans of a track (default:
freiburg-079.revisit); the mapped scans of the track run are sorted into its classes. Prints, for
each seed, the share that falls into a class registered at its place, or a neighbour of one, and
the share of pairs of a mapped scan and a place over 5 m away of which that holds: `here` and `far`
with the classes of all build scans within 1 m and 40° of the place, `nearest` with the one class of
the build scan there. True poses (`build.tum`, `track.tum`) only score; see `data.py` for where the
logs lie.
"""

import argparse
import dataclasses
import sys

import numpy as np
from data import track_folder

import aprjax
from aprjax.io.trajectory import read_tum
from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import scan_features
from aprjax.places.recognition import recognition


def main() -> int:
    """Train, classify, print; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
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
    print("seed  mapped   here    far  here_nearest  far_nearest  neurons")
    rows = []
    for seed in range(arguments.seeds):
        classifier = ViewClassifier.train(runs["build"][0], scan_features, seed)
        classes = {name: classifier.classify(scans) for name, (scans, _) in runs.items()}
        result = recognition(
            classifier.gas,
            (runs["build"][1], classes["build"]),
            (runs["track"][1], classes["track"]),
        )
        rows.append([*dataclasses.astuple(result), int(classifier.gas.alive.sum())])
        show(str(seed), rows[-1])
    show("mean", list(np.mean(rows, axis=0)))
    return 0


def show(label: str, row: list[float]) -> None:
    """One line of the table."""
    mapped, here, far, here_nearest, far_nearest, neurons = row
    print(
        f"{label:4s}  {mapped:6.0f}  {here:.3f}  {far:.3f}  {here_nearest:12.3f}"
        f"  {far_nearest:11.3f}  {neurons:7.0f}"
    )


if __name__ == "__main__":
    sys.exit(main())
