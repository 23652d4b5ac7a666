"""Length correspondences and matching angles by loops over pairs of edges (paper 2.B, 2.C)."""

import numpy as np


def edges(xy, valid):
    """All undirected edges (a, b, length, direction in [0, π)) of one complete graph."""
    found = []
    for a in range(len(xy)):
        for b in range(a + 1, len(xy)):
            if valid[a] and valid[b]:
                dx, dy = float(xy[b][0]) - float(xy[a][0]), float(xy[b][1]) - float(xy[a][1])
                if dx or dy:
                    found.append((a, b, np.hypot(dx, dy), np.arctan2(dy, dx) % np.pi))
    return found


def count(lengths, others, tolerance):
    """c_m: pairs of one length of each list that differ by at most the tolerance."""
    return sum(abs(d - e) <= tolerance for d in lengths for e in others)


def quality(count, k_act, k_m):
    """q_m; a graph without edges has none in common with any."""
    return count**2 / (k_act * k_m) if k_act and k_m else 0.0


def matching_angles(query, reference, bins, tolerance):
    """Votes for each direction difference; both are lists of (length bin, direction bin)."""
    histogram = np.zeros(bins, int)
    for length, direction in query:
        for other, turned in reference:
            if abs(length - other) <= tolerance:
                histogram[(turned - direction) % bins] += 1
    return histogram
