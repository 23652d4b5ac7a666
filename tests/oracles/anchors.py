"""Anchor extraction in plain loops over float64, sharing no code with aprjax."""

import numpy as np


class Beams:
    """What REP 117 says of each beam, and where it ended."""

    def __init__(self, ranges, angle_min, step, range_min, range_max):
        self.ranges = np.asarray(ranges, np.float64)
        self.angle_min = float(angle_min)
        self.step = float(step)
        self.least = float(range_min)
        self.limit = float(range_max)
        self.count = len(self.ranges)
        self.hit = [bool(range_min <= r <= range_max) for r in self.ranges]
        self.free = [bool(r == np.inf) for r in self.ranges]
        self.closed = (self.count + 0.5) * abs(self.step) > 2 * np.pi
        self.xy = np.zeros((self.count, 2))
        for i in range(self.count):
            if self.hit[i]:
                bearing = self.angle_min + i * self.step
                self.xy[i] = self.ranges[i] * np.array([np.cos(bearing), np.sin(bearing)])

    def bridged(self, angle, dropout, gap, incidence):
        """These beams with those filled in that a surface runs on across."""
        filled = list(self.ranges)
        spacing = _spacing(self.step, incidence)
        for i in range(self.count):
            j, run = self.after(i), []
            while j is not None and j != i and not self.hit[j]:
                run.append(j)
                j = self.after(j)
            if not run or j is None or not (self.hit[i] and self.hit[j]):
                continue
            widest = dropout if any(self.free[k] for k in run) else angle
            if (len(run) + 1) * abs(self.step) > widest:
                continue
            distance = np.hypot(*(self.xy[j] - self.xy[i]))
            nearer = min(self.ranges[i], self.ranges[j])
            if distance > gap + spacing * nearer:
                continue
            for k in run:
                bearing = self.angle_min + k * self.step
                rays = [[np.cos(bearing), np.sin(bearing)], self.xy[i] - self.xy[j]]
                filled[k] = np.linalg.solve(np.transpose(rays), self.xy[i])[0]
        return Beams(filled, self.angle_min, self.step, self.least, self.limit)

    def after(self, i):
        """The beam that follows i, or None at the end of the field of view."""
        if i + 1 < self.count:
            return i + 1
        return 0 if self.closed else None

    def before(self, i):
        if i > 0:
            return i - 1
        return self.count - 1 if self.closed else None


def parts(beams, gap, incidence):
    """Connected parts, each a list of beams in the order of the sweep."""
    spacing = _spacing(beams.step, incidence)

    def linked(i):
        j = beams.after(i)
        if j is None or not (beams.hit[i] and beams.hit[j]):
            return False
        distance = np.hypot(*(beams.xy[i] - beams.xy[j]))
        return distance <= gap + spacing * min(beams.ranges[i], beams.ranges[j])

    if beams.count and all(linked(i) for i in range(beams.count)):
        return [list(range(beams.count))]  # a closed room, which may be cut anywhere
    found = []
    for i in range(beams.count):
        before = beams.before(i)
        if not beams.hit[i] or (before is not None and linked(before)):
            continue
        part = [i]
        while linked(part[-1]):
            part.append(beams.after(part[-1]))
        found.append(part)
    return found


def _spacing(step, incidence):
    return np.sin(abs(step)) / np.sin(max(incidence - abs(step), 0.5 * incidence))


def is_large(beams, part, min_extent, min_beams):
    extent = max(np.hypot(*(beams.xy[i] - beams.xy[part[0]])) for i in part)
    return extent >= min_extent and len(part) >= min_beams


def jump_edges(beams, large_parts, jump, relative, weight):
    """Rows x, y, salience of the near ends of range discontinuities."""
    found = []
    for part in large_parts:
        for end, inner, beyond in (
            (part[0], part[min(1, len(part) - 1)], beams.before(part[0])),
            (part[-1], part[max(-2, -len(part))], beams.after(part[-1])),
        ):
            if beyond is None or not (beams.hit[beyond] or beams.free[beyond]):
                continue
            near, course = beams.ranges[end], 2 / beams.ranges[end] - 1 / beams.ranges[inner]
            goes_on = max(near, 1 / course) if course > 0 else np.inf  # a straight surface
            grows = (beams.limit if beams.free[beyond] else beams.ranges[beyond]) - goes_on
            if grows <= jump + relative * beams.ranges[end]:
                continue
            step = beams.xy[end] - beams.xy[inner]
            length = np.hypot(*step)
            xy = beams.xy[end] + step / length * min(0.5 * length, 0.1)
            found.append([*xy, weight * min(grows, 1.0)])
    return np.array(found).reshape(-1, 3)


def side(beams, part, place, sign, window, spacings, samples):
    """The hits, evenly spread, within the window on one side of the hit at `place` of a part."""
    here = beams.xy[part[place]]
    room = len(part) - 1 - place if sign > 0 else place
    if room == 0:
        return []
    first = np.hypot(*(beams.xy[part[place + sign]] - here))
    window = max(window, spacings * first)
    count = 0
    while count < room and np.hypot(*(beams.xy[part[place + sign * (count + 1)]] - here)) <= window:
        count += 1
    offsets = sorted({int(np.ceil(k * count / samples)) for k in range(1, samples + 1)} - {0})
    return [beams.xy[part[place + sign * k]] for k in offsets]


def line(points):
    """Total least squares: centre, direction, spread along and across, by singular values."""
    points = np.array(points)
    centre = points.mean(axis=0)
    _, values, axes = np.linalg.svd(points - centre)
    across = values[1] if len(values) > 1 else 0.0
    direction = np.arctan2(axes[0, 1], axes[0, 0])
    return centre, direction, values[0] / len(points) ** 0.5, across / len(points) ** 0.5


def intersection(point_a, direction_a, point_b, direction_b):
    """Where two lines meet, by solving a + s u = b + t v."""
    u = np.array([np.cos(direction_a), np.sin(direction_a)])
    v = np.array([np.cos(direction_b), np.sin(direction_b)])
    s, _ = np.linalg.solve(np.stack([u, -v], axis=1), np.subtract(point_b, point_a))
    return np.asarray(point_a) + s * u
