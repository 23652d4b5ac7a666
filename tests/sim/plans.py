"""Distances in simulated worlds, in NumPy alone."""

import numpy as np


def clearance_of(world, xy: np.ndarray) -> np.ndarray:
    """Metres `(P,)` from points `(P, 2)` to the nearest surface of a world."""
    segments, circles = (np.asarray(part, float) for part in (world.segments, world.circles))
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    best = np.full(len(xy), np.inf)
    for i, point in enumerate(xy):
        share = np.clip(((point - start) * along).sum(axis=1) / square, 0, 1)
        wall = np.linalg.norm(start + share[:, None] * along - point, axis=1).min()
        real = circles[circles[:, 2] > 0]
        round_ = np.abs(np.linalg.norm(real[:, :2] - point, axis=1) - real[:, 2])
        best[i] = min(wall, round_.min() if len(real) else np.inf)
    return best
