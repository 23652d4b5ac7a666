"""The coarse drawing of a view and the glance at two of them, cell by cell and point by point."""

import math

import numpy as np

from tests.oracles.evaluation import inverse, look_up


def drawing(view, config):
    """{(i, j): "agrees" or "contradicts"} of the cells that say something."""
    found, half = {}, config.size / 2
    for i in range(config.size):
        for j in range(config.size):
            point = (np.array([i, j]) + 0.5 - half) * float(config.cell)
            (index,), (visible,) = look_up(view, [point])
            if not visible or not view.hit[index]:
                continue
            distance, met = math.hypot(*point), float(view.range[index])
            tolerance = float(config.tolerance) + float(config.relative) * distance
            if abs(distance - met) <= tolerance:
                found[i, j] = "agrees"
            elif distance < met:
                found[i, j] = "contradicts"
    return found


def end_points(view, config):
    """Hits of at most `points` beams evenly spread over the scan."""
    beams, size = int(view.beams), min(config.points, len(view.xy))
    chosen = [k * beams // size for k in range(size)] if beams > size else range(beams)
    return [np.asarray(view.xy[k], float) for k in chosen if view.hit[k]]


def share(cells, points, T, raster_config, config):
    """The share of points, moved by T, that agree with a drawing; doubt weighs as some that don't.

    Points outside the drawing, and in cells that say nothing, count neither way.
    """
    x, y, theta = T
    c, s = math.cos(theta), math.sin(theta)
    said = []
    for p, q in points:
        moved = x + c * p - s * q, y + s * p + c * q
        cell = tuple(
            math.floor(along / float(raster_config.cell) + raster_config.size / 2)
            for along in moved
        )
        said.append(cells.get(cell))
    agree, against = said.count("agrees"), said.count("contradicts")
    doubt = float(config.doubt) * len(points)
    return agree / max(agree + float(config.contradiction) * against + doubt, 1.0)


def glance(reference, query, T_ref_query, rating, raster_config, config):
    """Both shares, and how many edges voted; scans are (drawing, end points)."""
    ahead = share(reference[0], query[1], T_ref_query, raster_config, config)
    back = share(query[0], reference[1], inverse(T_ref_query), raster_config, config)
    return ahead * back * rating / (rating + float(config.votes))
