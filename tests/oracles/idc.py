"""Slow reference for iterative dual correspondence: pairs point by point, rotation by SVD.

A view is any object with the arrays of `aprjax`'s `View`; poses are `x, y, theta` in metres and
radians. Entries that are not hits are left out rather than masked.
"""

import math

import numpy as np

from tests.oracles.evaluation import compose, inverse


def pieces(view):
    """Both ends of each piece of surface; a hit that no next one is linked to is a piece."""
    xy, hit = np.asarray(view.xy, float), np.asarray(view.hit)
    following = np.where(np.asarray(view.linked)[:, None], np.roll(xy, -1, axis=0), xy)
    return xy[hit], following[hit]


def closest(view, point):
    """The point of the surface nearest to `point`."""
    a, b = pieces(view)
    length = ((b - a) ** 2).sum(axis=1)
    share = np.clip(((point - a) * (b - a)).sum(axis=1) / np.maximum(length, 1e-12), 0, 1)
    feet = a + share[:, None] * (b - a)
    return feet[np.argmin(np.linalg.norm(point - feet, axis=1))]


def same_range(view, point, window, nearness):
    """The point of the surface within the window whose range is nearest to that of `point`.

    None if there is none. Ranges along a piece are interpolated; `nearness` prefers, among equal
    ranges, what is near in bearing.
    """
    a, b = pieces(view)
    r, near, far = np.linalg.norm(point), np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    sloped = np.abs(far - near) > 1e-4
    share = np.where(sloped, np.clip((r - near) / np.where(sloped, far - near, 1), 0, 1), 0)
    feet, along = a + share[:, None] * (b - a), near + share * (far - near)
    off = (along - r) ** 2
    chord = np.maximum(((point - feet) ** 2).sum(axis=1) - off, 0.0)
    turn = 2 * np.arcsin(np.minimum(np.sqrt(chord / (4 * r * along)), 1.0))
    cost = np.where(turn <= window, off + nearness**2 * chord, np.inf)
    return feet[np.argmin(cost)] if np.isfinite(cost.min()) else None


def rigid(start, goal, weight):
    """Turn about the origin and shift after it of weighted least squares, by SVD (Kabsch)."""
    a, b = (np.average(xy, axis=0, weights=weight) for xy in (start, goal))
    covariance = (weight[:, None] * (start - a)).T @ (goal - b)
    left, _, right = np.linalg.svd(covariance)
    keep = np.diag([1.0, np.sign(np.linalg.det(right.T @ left.T))])
    rotation = right.T @ keep @ left.T
    return math.atan2(rotation[1, 0], rotation[0, 0]), b - rotation @ a


def step(reference, query, T_ref_query, gate, window, nearness):
    """One step with every hit of both scans: shift by closest points, turn by ranges."""
    T = np.asarray(T_ref_query, float)

    def moved(T, xy):
        return np.array([compose(T, [*point, 0.0])[:2] for point in xy])

    def weight(gap):
        return (1 - np.minimum(gap / gate, 1) ** 2) ** 2

    ours, theirs = (np.asarray(v.xy, float)[np.asarray(v.hit)] for v in (query, reference))
    here = moved(T, ours)
    feet = np.array([closest(reference, point) for point in here])
    seen = moved(inverse(T), theirs)
    back = moved(T, [closest(query, point) for point in seen])
    start, goal = np.concatenate([here, back]) - T[:2], np.concatenate([feet, theirs]) - T[:2]
    _, shift = rigid(start, goal, weight(np.linalg.norm(start - goal, axis=1)))
    partners = [same_range(reference, point, window, nearness) for point in here]
    kept = [i for i, partner in enumerate(partners) if partner is not None]
    there = np.array([partners[i] for i in kept])
    off = np.abs(np.linalg.norm(there, axis=1) - np.linalg.norm(here[kept], axis=1))
    turn, _ = rigid(here[kept] - T[:2], there - T[:2], weight(off))
    return np.array([*(T[:2] + shift), T[2] + turn])
