"""Office floors made of line segments, and exact scans of them, in NumPy alone."""

from itertools import pairwise

import numpy as np

from aprjax.scan import Scan

DOOR = 0.9


def office(seed: int, length: float = 24.0) -> np.ndarray:
    """A corridor along x with rooms on both sides, as segments `(S, 2, 2)` in metres.

    The rooms differ in width and, between the sides, in depth; each has a door, a cupboard at its
    back wall and most have a niche beside the door, on the corridor's side. The floor spans
    x in [0, length]; y = 0 is the middle of the corridor.
    """
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.9, 1.3)
    segments: list[list[tuple[float, float]]] = []

    def polyline(*points: tuple[float, float]) -> None:
        segments.extend([a, b] for a, b in pairwise(points))

    for side in (-1, 1):
        front = side * half
        back = front + side * rng.uniform(3.5, 6.0)
        polyline((0, 0), (0, back), (length, back), (length, 0))
        bounds = [0.0]
        while bounds[-1] < length - 9:
            bounds.append(bounds[-1] + rng.uniform(2.8, 6.0))
        bounds.append(length)
        for left, right in pairwise(bounds):
            polyline((right, front), (right, back))
            door = rng.uniform(left + 0.2, right - DOOR - 1.2)
            polyline((left, front), (door, front))
            after, recess = door + DOOR, front + side * rng.choice([0.0, 0.25, 0.4])
            niche = after + 0.2, after + rng.uniform(0.5, 0.9)
            polyline(
                (after, front),
                (niche[0], front),
                (niche[0], recess),
                (niche[1], recess),
                (niche[1], front),
                (right, front),
            )
            cupboard, shelf = rng.uniform(left, right - 1.6), back - side * rng.uniform(0.3, 0.6)
            end = cupboard + rng.uniform(0.6, 1.6)
            polyline((cupboard, back), (cupboard, shelf), (end, shelf), (end, back))
    return np.array(segments)


def cast(segments: np.ndarray, pose: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    """Distances `(B,)` in metres from `pose` to the nearest segment along `bearings` `(B,)`.

    Infinite where nothing is hit. Bearings are relative to the pose's heading, in radians; a
    segment that is parallel to a ray is not hit.
    """
    angles = pose[2] + bearings
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    along = segments[:, 1] - segments[:, 0]
    offset = segments[:, 0] - pose[:2]
    cross = ray[..., 0] * along[:, 1] - ray[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / cross
        share = (offset[:, 0] * ray[..., 1] - offset[:, 1] * ray[..., 0]) / cross
    # A ray must not slip between two segments that share an end.
    hit = (cross != 0) & (distance > 0) & (share >= -1e-9) & (share <= 1 + 1e-9)
    return np.where(hit, distance, np.inf).min(axis=1)


def clearance(segments: np.ndarray, xy: np.ndarray) -> float:
    """Distance in metres from the point `xy` to the nearest segment."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((xy - start) * along).sum(axis=1) / length, 0, 1)
    return float(np.linalg.norm(start + share[:, None] * along - xy, axis=1).min())


def free_pose(segments: np.ndarray, rng: np.random.Generator, gap: float = 0.5) -> np.ndarray:
    """A random pose `(3,)` of the floor, at least `gap` metres from every segment."""
    low, high = segments.min(axis=(0, 1)), segments.max(axis=(0, 1))
    while True:
        xy = rng.uniform(low, high)
        if clearance(segments, xy) >= gap:
            return np.append(xy, rng.uniform(-np.pi, np.pi))


def scan_at(
    world: np.ndarray,
    pose: np.ndarray,
    beams: int = 181,
    fov: float = np.pi,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    range_max: float = 30.0,
) -> Scan:
    """A scan of segments `world` from `pose`, the first and last beam `fov` radians apart.

    `noise` is the standard deviation of the ranges in metres and asks for `rng`. Beams that hit
    nothing within `range_max` have no return.
    """
    step = fov / (beams - 1)
    ranges = cast(world, pose, -fov / 2 + step * np.arange(beams))
    if noise:
        assert rng is not None, "noise asks for a generator"
        ranges = ranges + rng.normal(0, noise, beams)
    ranges[ranges > range_max] = np.inf
    return Scan.make(ranges, angle_min=-fov / 2, angle_increment=step, range_max=range_max)
