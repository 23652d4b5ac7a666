"""Votes of corresponding edges as a dictionary of cells, in float64 (paper 2.B, 2.C).

No hash, no slices: every pair of an edge of the query and one of a reference is looked at.
"""

from collections import defaultdict

import numpy as np

from tests.oracles.alignment import pose_of_edge
from tests.oracles.relations import edges


def centre(query):
    """The middle of the query's anchors; graphs are (xy, valid)."""
    xy, valid = query
    return np.mean(np.float64(xy)[np.asarray(valid, bool)], axis=0)


def place(T, point):
    """Where a pose puts a point."""
    x, y, theta = np.asarray(T, float)
    c, s = np.cos(theta), np.sin(theta)
    return np.array([x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]])


def cell_of(T, middle, grid, config):
    """The cell of rotation and place of a pose in one of the shifted grids, before rounding down.

    The rotation is in units of cells, modulo a full turn; so are both coordinates of the place.
    """
    shift = grid / config.grids
    turn = T[2] / (2 * np.pi) * config.directions + shift
    return np.array([turn % config.directions, *(place(T, middle) / float(config.cell) + shift)])


def cells(references, query, config):
    """{(row, grid, cell): [(length of the query's edge, pose), ...]} of all corresponding edges."""
    found, middle = defaultdict(list), centre(query)
    for row, reference in enumerate(references):
        for a, b, d, _ in edges(*reference):
            for v, w, e, _ in edges(*query):
                if abs(d - e) > float(config.length):
                    continue
                for ends in ((a, b), (b, a)):
                    T = pose_of_edge(reference[0], query[0], *ends, v, w)
                    for grid in range(config.grids):
                        cell = tuple(np.floor(cell_of(T, middle, grid, config)).astype(int))
                        found[row, grid, cell].append((e, T))
    return found
