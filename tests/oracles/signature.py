"""Histograms of surflet pairs, pair by pair."""

import numpy as np

REACH, LONGEST, POINTS = 10.0, 0.5, 48
DISTANCES, TURNS, SLANTS = 16, 3, 5


def spread(view):
    """Points evenly along the surfaces, and their normals."""
    count = len(view.xy)
    upto, total = [], 0.0
    for k in range(count):
        length = 0.0
        for a, b in ((k - 1, k), (k, k + 1)):
            if a >= 0 and b < count and view.linked[a]:
                length += float(np.hypot(*(view.xy[b] - view.xy[a]))) / 2
        if view.hit[k] and np.any(view.normal[k] != 0):
            total += min(length, LONGEST)
        upto.append(total)
    chosen = []
    for k in range(POINTS):
        place = (k + 0.5) / POINTS * total
        chosen.append(next(i for i, reached in enumerate(upto) if reached >= place))
    return view.xy[chosen].astype(float), view.normal[chosen].astype(float)


def pair_histogram(view):
    """Square roots of the shares of pairs in each bin of (distance, turn, slants)."""
    xy, normal = spread(view)
    slants = {}
    for high in range(SLANTS):
        for low in range(high + 1):
            slants[low, high] = len(slants)
    counts = np.zeros((DISTANCES, TURNS, len(slants)))

    def part(cosine, bins):
        return min(max(int(np.floor((cosine + 1) / 2 * bins)), 0), bins - 1)

    for a in range(POINTS):
        for b in range(a + 1, POINTS):
            line = xy[b] - xy[a]
            distance = float(np.hypot(*line))
            far = int(distance / REACH * DISTANCES)
            if far >= DISTANCES:
                continue
            along = line / max(distance, 1e-6)
            mine, theirs = part(normal[a] @ along, SLANTS), part(-normal[b] @ along, SLANTS)
            turn = part(normal[a] @ normal[b], TURNS)
            counts[far, turn, slants[min(mine, theirs), max(mine, theirs)]] += 1
    return np.sqrt(counts.ravel() / counts.sum())
