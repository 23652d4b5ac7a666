"""A corridor that leads round in a ring, and a robot that drives in it, in NumPy alone."""

import tempfile
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from aprjax.cli.main import main
from aprjax.io.carmen_writer import write_log
from aprjax.io.log import LogEntry
from aprjax.scan import Scan
from aprjax.sim.odometry import OdometryConfig, odometry
from tests.worlds import scan_at

LENGTH, DEPTH, WIDTH = 12.0, 8.0, 2.2  # metres of the corridor's middle line, and its width
LAP = 2 * (LENGTH + DEPTH)


def ring(seed: int) -> np.ndarray:
    """The walls as segments `(S, 2, 2)`, with niches of all sizes on both sides."""
    rng = np.random.default_rng(seed)
    segments = []
    for side in (-1, 1):  # the inner wall, and the outer one
        half = side * WIDTH / 2
        low, high = np.array([-half, -half]), np.array([LENGTH + half, DEPTH + half])
        corners = [low, (high[0], low[1]), high, (low[0], high[1]), low]
        for start, end in pairwise(np.array(corners, float)):
            along = (end - start) / np.linalg.norm(end - start)
            across = side * np.array([along[1], -along[0]])
            at, points = rng.uniform(0.4, 1.2), [start]
            while at < np.linalg.norm(end - start) - 2.0:
                width, deep = rng.uniform(0.4, 1.4), rng.uniform(0.2, 0.8)
                niche = [(at, 0.0), (at, deep), (at + width, deep), (at + width, 0.0)]
                points += [start + a * along + d * across for a, d in niche]
                at += width + rng.uniform(0.5, 2.5)
            segments += [[a, b] for a, b in pairwise([*points, end])]
    return np.array(segments)


def poses(way: np.ndarray) -> np.ndarray:
    """Where a robot is after driving `way` `(N,)` metres round the corridor: `(N, 3)`."""
    xs = np.cumsum([0, LENGTH, DEPTH, LENGTH, DEPTH])
    corners = np.array([(0, 0), (LENGTH, 0), (LENGTH, DEPTH), (0, DEPTH), (0, 0)], float)
    lap = np.mod(way, LAP)
    xy = np.stack([np.interp(lap, xs, corner) for corner in corners.T], axis=-1)
    # It turns over a metre about each corner.
    turns = np.interp(way, *_turning(way.max() + 1))
    return np.concatenate([xy, ((turns + np.pi) % (2 * np.pi) - np.pi)[:, None]], axis=1)


def _turning(until: float) -> tuple[np.ndarray, np.ndarray]:
    """Ways and headings between which the heading is interpolated."""
    ways, headings, at, heading = [0.0], [0.0], 0.0, 0.0
    for leg in np.tile([LENGTH, DEPTH], 40):
        at += leg
        if at > until + LAP:
            break
        ways += [at - 0.5, at + 0.5]
        headings += [heading, heading + np.pi / 2]
        heading += np.pi / 2
    return np.array(ways), np.array(headings)


def drive(seed: int, way: float, step: float = 0.5) -> tuple[list[LogEntry], np.ndarray]:
    """A log of `way` metres round the ring, with the wheels' errors, and the true poses."""
    world, rng = ring(seed), np.random.default_rng(seed)
    truth = poses(np.arange(0, way, step))
    errors = OdometryConfig(scale=0.05, slip=0.05, heading=0.04, turning=0.06)  # pyright: ignore[reportArgumentType]
    wheels, _ = odometry(seed, truth, 0.5 * np.arange(len(truth)), errors)
    return [
        LogEntry(scan_at(world, pose, noise=0.01, rng=rng), wheel, 0.5 * k, "ROBOTLASER1", None, k)
        for k, (pose, wheel) in enumerate(zip(truth, wheels, strict=True))
    ], truth


@cache
def mapped() -> tuple[Path, Path, np.ndarray]:
    """A log of a lap and a half, the map that the command line built of it, and the true poses.

    Built once for all tests: what a build compiles is most of the time that they take.
    """
    entries, truth = drive(seed=3, way=1.45 * LAP)
    folder = Path(tempfile.mkdtemp())
    log, path = folder / "drive.log.gz", folder / "drive.map"
    scans = Scan.stack([entry.scan for entry in entries], slots=181)
    wheels = np.array([entry.odometry for entry in entries])
    write_log(log, scans, wheels, 0.5 * np.arange(len(entries)))
    assert main(["map", "build", str(log), "--out", str(path)]) == 0
    return log, path, truth
