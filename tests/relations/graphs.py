"""Anchor graphs made from points."""

import jax
import numpy as np

from aprjax.anchors.extract import Anchors
from aprjax.relations.graph import anchor_graph

SLOTS = 16
_graph = jax.jit(anchor_graph)


def anchors(xy, valid=None, slots=SLOTS, fill=0.0):
    """Anchors at `xy`, padded to `slots` with invalid ones at `fill`."""
    xy = np.asarray(xy, np.float32).reshape(-1, 2)
    valid = np.ones(len(xy), bool) if valid is None else np.asarray(valid)
    missing = slots - len(xy)
    return Anchors(
        xy=np.pad(xy, [(0, missing), (0, 0)], constant_values=fill),
        kind=np.zeros(slots, np.int32),
        salience=np.pad(np.ones(len(xy), np.float32), (0, missing)),
        valid=np.pad(valid, (0, missing)),
        overflow=np.int32(0),
    )


def graph(xy, valid=None, slots=SLOTS, fill=0.0):
    return _graph(anchors(xy, valid, slots, fill))


def stacked(items):
    return jax.tree.map(lambda *arrays: np.stack(arrays), *items)


def scattered(seed, count, size=6.0):
    """Points at random, in float32."""
    return np.random.default_rng(seed).uniform(-size, size, (count, 2)).astype(np.float32)


def moved(pose, xy):
    """Points of frame b in frame a, `pose` being `T_a_b`."""
    x, y, theta = pose
    c, s = np.cos(theta), np.sin(theta)
    return np.asarray(xy, np.float64) @ np.array([[c, s], [-s, c]]) + [x, y]
