"""Slow references for what is done with views: look-up, synthetic scans, verdicts, refinement.

Plain loops over NumPy arrays. A view is any object with the arrays of `aprjax`'s `View`; poses are
`x, y, theta` in metres and radians.
"""

import math

import numpy as np


def compose(T_a_b, T_b_c):
    """`T_a_c`, by matrices."""
    return _pose(_matrix(T_a_b) @ _matrix(T_b_c))


def inverse(T_a_b):
    """`T_b_a`, by matrices."""
    return _pose(np.linalg.inv(_matrix(T_a_b)))


def between(T_w_a, T_w_b):
    """`T_a_b` of two poses in one frame."""
    return compose(inverse(T_w_a), T_w_b)


def error(T, T_true):
    """Distance in metres and angle in radians between two poses."""
    x, y, theta = between(T_true, T)
    return math.hypot(x, y), abs(theta)


def look_up(view, xy):
    """The entry nearest in bearing to each point, and whether the point is in the field of view.

    The field of view reaches half a beam's step past its outer beams.
    """
    beams, step = int(view.beams), float(view.angle_increment)
    bearings = float(view.angle_min) + step * np.arange(beams)
    found = []
    for x, y in np.asarray(xy, float):
        off = np.abs(np.angle(np.exp(1j * (math.atan2(y, x) - bearings))))
        nearest = int(np.argmin(off))
        found.append((nearest, off[nearest] <= abs(step) / 2))
    index, visible = zip(*found, strict=True)
    return np.array(index), np.array(visible)


def synthetic_ranges(view, T_front_overview, bearings):
    """Ranges along `bearings` from the front pose to the surfaces of the view; infinite if none.

    A surface piece joins two linked hits, and counts if it is seen from the side that the
    overview saw it from: with the interior of its sweep on the same hand.
    """
    points = [_move(T_front_overview, point).tolist() for point in np.asarray(view.xy, float)]
    sense = math.copysign(1, float(view.angle_increment))
    pieces = [
        (points[i], points[(i + 1) % len(points)]) for i in np.nonzero(np.asarray(view.linked))[0]
    ]
    pieces = [(p, q) for p, q in pieces if sense * (p[0] * q[1] - p[1] * q[0]) > 1e-6]
    ranges = []
    for bearing in np.asarray(bearings, float):
        nearest = math.inf
        for p, q in pieces:
            nearest = min(nearest, _crossing(p, q, bearing))
        ranges.append(nearest)
    return np.array(ranges)


def verdicts(overview, front, T_front_overview, config):
    """How many beams agree, contradict, and met a surface at all (for one alignment)."""
    assert front.beams <= config.beams, "every beam is compared"
    beams = np.nonzero(np.asarray(front.hit))[0]
    bearing = float(front.angle_min) + beams * float(front.angle_increment)
    claimed = synthetic_ranges(overview, T_front_overview, bearing)
    T_overview_front = inverse(T_front_overview)
    agree = contradict = 0
    for i, expected in zip(beams, claimed, strict=True):
        measured = float(front.range[i])
        tolerance = float(config.tolerance) + float(config.relative) * measured
        if abs(measured - expected) <= tolerance:
            agree += 1
        elif measured > expected:
            contradict += 1
        else:
            point = _move(T_overview_front, np.asarray(front.xy[i], float))
            (index,), (visible,) = look_up(overview, [point])
            seen_past = overview.range[index] > math.hypot(*point) + tolerance
            contradict += bool(visible and overview.hit[index] and seen_past)
    return agree, contradict, len(beams)


def robust_cost(reference, query, T_ref_query, gate):
    """Mean truncated squared distance of the query's points from the surfaces at their bearings.

    Points that fall on nothing known, or farther off than `gate` metres, cost `gate`².
    """
    xy = np.array([_move(T_ref_query, point) for point in np.asarray(query.xy, float)[query.hit]])
    index, visible = look_up(reference, xy)
    cost = 0.0
    for point, i, known in zip(xy, index, visible, strict=True):
        normal = np.asarray(reference.normal[i], float)
        off = normal @ (point - np.asarray(reference.xy[i], float))
        cost += min(off**2, gate**2) if known and normal.any() else gate**2
    return cost / len(xy)


def _matrix(T):
    x, y, theta = np.asarray(T, float)
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


def _pose(matrix):
    return np.array([matrix[0, 2], matrix[1, 2], math.atan2(matrix[1, 0], matrix[0, 0])])


def _move(T, point):
    return (_matrix(T) @ np.append(point, 1.0))[:2]


def _crossing(p, q, bearing):
    """Distance from the origin along `bearing` to the piece from p to q; infinite if it misses.

    Solves distance * ray = p + share * (q - p) by Cramer's rule.
    """
    ray_x, ray_y = math.cos(bearing), math.sin(bearing)
    along_x, along_y = q[0] - p[0], q[1] - p[1]
    determinant = ray_y * along_x - ray_x * along_y
    if abs(determinant) < 1e-12:
        return math.inf
    distance = (along_x * p[1] - along_y * p[0]) / determinant
    share = (ray_x * p[1] - ray_y * p[0]) / determinant
    return distance if distance > 0 and 0 <= share <= 1 else math.inf
