"""The discriminant of the signatures, from simulated floors.

    python -m experiments signature --out DIR [--quick]

Floors as `experiments/million.py` makes them, but others. Histograms of surflet pairs of scans of
one place, taken within 2 m and 40° of each other, some of them after furniture was moved, differ
by what a signature should not depend on; those of all scans by what it may. The axes are those
along which all differ most, measured by how one place's do (Fisher's linear discriminant). Those
of one place are regularised by a hundredth of their greatest variance. Writes `mean` and `axes` of
300 floors, with --quick of 3, into DIR/discriminant.npz; that of `aprjax/evaluation` was made so.
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

import aprjax
from aprjax.atomic import atomic_write
from aprjax.evaluation.signature import pair_histogram
from aprjax.features import seen
from aprjax.metrics import relative
from experiments.million import AT_ONCE, EACH, NEAR_ANGLE, NEAR_DISTANCE, floors

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
        gap = relative(poses[here][None], poses[here][:, None])
        near = np.hypot(gap[..., 0], gap[..., 1]) <= NEAR_DISTANCE
        first, second = np.nonzero(np.triu(near & (np.abs(gap[..., 2]) <= NEAR_ANGLE), k=1))
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


def main() -> int:
    """Make the floors, write the file; the exit status."""
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
    mean, axes = discriminant(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    with atomic_write(arguments.out / "discriminant.npz", "wb") as file:
        np.savez_compressed(file, mean=mean.astype(np.float16), axes=axes.astype(np.float16))
    return 0


if __name__ == "__main__":
    sys.exit(main())
