"""Walls to scan, and comparison of point sets."""

from itertools import pairwise

import numpy as np

from aprjax.scan import Scan
from tests.worlds import cast

FULL = 384
"""Beams of a full turn, at the slot count that the tests compile for."""
SPACING = 2 * np.pi / FULL
"""Their angle."""


def polyline(*points, closed=False):
    """Walls between consecutive points."""
    points = [*points, points[0]] if closed else points
    return np.array([[a, b] for a, b in pairwise(points)], float)


def room(width, depth):
    """Four walls around the origin."""
    x, y = width / 2, depth / 2
    return polyline((-x, -y), (x, -y), (x, y), (-x, y), closed=True)


def box(x, y, size):
    """A square object at (x, y)."""
    h = size / 2
    return polyline((x - h, y - h), (x + h, y - h), (x + h, y + h), (x - h, y + h), closed=True)


def turn_at(world, pose, beams=FULL, start=-np.pi, noise=0.0, seed=0, range_max=30.0):
    """A full turn from `pose`, beam 0 along the bearing `start`."""
    step = 2 * np.pi / beams
    ranges = cast(world, np.asarray(pose, float), start + step * np.arange(beams))
    ranges = ranges + noise * np.random.default_rng(seed).normal(size=beams)
    return Scan.make(ranges, angle_min=start, angle_increment=step, range_max=range_max)


def rebuilt(scan, ranges=None, angle_min=None, angle_increment=None):
    """The scan with some fields others."""
    return Scan.make(
        scan.ranges if ranges is None else ranges,
        angle_min=float(scan.angle_min if angle_min is None else angle_min),
        angle_increment=float(scan.angle_increment if angle_increment is None else angle_increment),
        range_min=float(scan.range_min),
        range_max=float(scan.range_max),
    )


def mirrored(scan):
    """What a mirror image of the world looks like: left and right exchanged."""
    last = float(scan.angle_min) + (len(scan.ranges) - 1) * float(scan.angle_increment)
    return rebuilt(scan, scan.ranges[::-1], angle_min=-last)


def upside_down(scan):
    """The same sweep by a scanner that turns the other way."""
    last = float(scan.angle_min) + (len(scan.ranges) - 1) * float(scan.angle_increment)
    return rebuilt(scan, scan.ranges[::-1], last, -float(scan.angle_increment))


def seen_from(pose, points):
    """World points in the frame of a sensor at `pose`."""
    x, y, theta = pose
    c, s = np.cos(theta), np.sin(theta)
    return (np.asarray(points, float) - [x, y]) @ np.array([[c, -s], [s, c]])


def turned(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def points_of(candidates, kind=None):
    """Valid points `(n, 2)`, of one kind or all."""
    valid = np.asarray(candidates.valid)
    if kind is not None:
        valid = valid & (np.asarray(candidates.kind) == kind)
    return np.asarray(candidates.xy)[valid]


def assert_same_points(a, b, tolerance):
    """Both sets pair off one to one within `tolerance` metres."""
    a, b = np.asarray(a).reshape(-1, 2), np.asarray(b).reshape(-1, 2)
    assert len(a) == len(b), f"{len(a)} points and {len(b)}:\n{a}\n{b}"
    gaps = np.linalg.norm(a[:, None] - b, axis=-1)
    if len(a):
        assert gaps.min(axis=0).max() <= tolerance, f"{gaps.min(axis=0)}\n{a}\n{b}"
        assert gaps.min(axis=1).max() <= tolerance


def assert_same_anchors(a, b, tolerance, move=lambda points: points):
    """The same anchors kind by kind, `b`'s points being `move` of `a`'s."""
    for kind in range(3):
        assert_same_points(move(points_of(a, kind)), points_of(b, kind), tolerance)


def distance_to(points, target):
    """Metres from the nearest of `points` to `target`."""
    points = np.asarray(points).reshape(-1, 2)
    return np.linalg.norm(points - target, axis=1).min() if len(points) else np.inf
