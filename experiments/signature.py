"""The discriminant of the signatures, from simulated floors.

    python -m experiments.signature --out DIR [--quick]

Floors as `experiments/million.py` makes them, but others. Histograms of surflet pairs of scans of
one place, taken within 2 m and 40° of each other, some of them after furniture was moved, differ
by what a signature should not depend on; those of all scans by what it may. The axes are those
along which all differ most, measured by how one place's do (Fisher's linear discriminant). Those
of one place are regularised by a hundredth of their greatest variance. Writes `mean` and `axes` of
300 floors, with --quick of 3, into DIR/discriminant.npz; that of `aprjax/evaluation` was made so.
Beside it, `signature.csv` and `signature.png` have the standard deviations along each axis, of all
scans and of those of one place; `configuration.json` is what made them.
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.atomic import atomic_write
from aprjax.evaluation.signature import pair_histogram
from aprjax.features import seen
from aprjax.metrics import NEAR_ANGLE, NEAR_DISTANCE, is_near
from experiments.million import AT_ONCE, EACH, floors
from experiments.outputs import BLUE, LIGHT, write_configuration, write_figure, write_table

SEED = 10_000_000  # the first floor's number; those measured begin with 0
FLOORS = 300
SIZE = 128  # axes
REGULAR = 0.01


@jax.jit
def _histograms(scans: aprjax.Scan, config: aprjax.FeatureConfig) -> jax.Array:
    return jax.lax.map(lambda scan: pair_histogram(seen(scan, config)), scans, batch_size=50)


def scattered(numbers: range) -> tuple[np.ndarray, np.ndarray]:
    """Histograms of all scans of some floors, and differences of those of one place."""
    made = floors(numbers, EACH)
    assert made.queries is not None
    config = aprjax.FeatureConfig()
    scans = [np.asarray(_histograms(s, config)) for s in (made.references, made.queries)]
    histograms, floor = np.concatenate(scans), np.concatenate([made.floor, made.query_floor])
    poses = np.concatenate([made.T_floor_ref, made.T_floor_query])
    differences = []
    for number in numbers:
        here = np.flatnonzero(floor == number)
        near = is_near(poses[here][None], poses[here][:, None])
        first, second = np.nonzero(np.triu(near, k=1))
        differences.append(histograms[here[first]] - histograms[here[second]])
    return histograms, np.concatenate(differences)


def discriminant(histograms: np.ndarray, differences: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean `(bins,)` and axes `(bins, SIZE)`."""
    mean = histograms.mean(axis=0)
    within = differences.T @ differences / (2 * len(differences))
    variance, directions = np.linalg.eigh(within.astype(float))
    whiten = directions / np.sqrt(np.maximum(variance, 0.0) + REGULAR * variance[-1])
    spread = np.cov(((histograms - mean) @ whiten).T)
    _, axes = np.linalg.eigh(spread)
    axes = whiten @ axes[:, ::-1][:, :SIZE]
    return mean, axes * np.sqrt(within.trace())


def along(histograms: np.ndarray, differences: np.ndarray, axes: np.ndarray) -> list[dict]:
    """How far scans differ along each axis: a row for it, the first one telling most."""
    every = np.std(histograms @ axes, axis=0)
    # A difference has both scans' variance.
    place = np.sqrt(np.mean((differences @ axes) ** 2, axis=0) / 2)
    return [
        {"axis": k, "all": f"{a:.5g}", "one_place": f"{p:.5g}", "ratio": f"{a / p:.5g}"}
        for k, (a, p) in enumerate(zip(every, place, strict=True))
    ]


def draw(rows: list[dict]) -> Figure:
    """The standard deviations over the axes."""
    figure = Figure(figsize=(6.5, 4.0), layout="constrained")
    ax = figure.add_subplot()
    for column, colour, label in (
        ("all", BLUE, "all scans"),
        ("one_place", LIGHT, "scans of one place"),
    ):
        values = [float(row[column]) for row in rows]
        ax.plot([row["axis"] for row in rows], values, color=colour, lw=1.6, label=label)
    ax.set(xlabel="axis", ylabel="standard deviation", ylim=(0, None))
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.legend(fontsize=8)
    return figure


def main() -> int:
    """Make the floors, write the files; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="3 floors")
    arguments = parser.parse_args()
    count, parts = 3 if arguments.quick else FLOORS, []
    for start in range(0, count, AT_ONCE):
        end = min(start + AT_ONCE, count)
        parts.append(scattered(range(SEED + start, SEED + end)))
        print(f"{end} of {count} floors", file=sys.stderr, flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    histograms, differences = (np.concatenate(each) for each in zip(*parts, strict=True))
    mean, axes = discriminant(histograms, differences)
    with atomic_write(arguments.out / "discriminant.npz", "wb") as file:
        np.savez_compressed(file, mean=mean.astype(np.float16), axes=axes.astype(np.float16))
    rows = along(histograms, differences, axes)
    write_table(rows, arguments.out / "signature.csv")
    write_figure(draw(rows), arguments.out / "signature.png")
    write_configuration(
        arguments.out, first=SEED, floors=count, axes=SIZE, regular=REGULAR,
        near_m=NEAR_DISTANCE, near_rad=NEAR_ANGLE,
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
