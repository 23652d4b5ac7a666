"""The correspondence matrix and the clustering of paper 2.C as loops, in float64."""

import numpy as np

from tests.oracles.relations import edges


def apart(angle, other, period):
    """Unsigned difference of two angles modulo the period."""
    gap = abs(angle - other) % period
    return min(gap, period - gap)


def paper_matrix(reference, query, length, rotation=None, tolerance=None):
    """Every corresponding pair of undirected edges increments four entries.

    With a rotation, only pairs whose directions differ by it, modulo half a turn, take part:
    those that belong to the peak of the matching angle histogram. Graphs are (xy, valid).
    """
    matrix = np.zeros((len(reference[0]), len(query[0])), int)
    for a, b, d, direction in edges(*reference):
        for v, w, e, turned in edges(*query):
            if abs(d - e) > length:
                continue
            if rotation is not None and apart(direction - turned, rotation, np.pi) > tolerance:
                continue
            for i, j in ((a, v), (b, w), (a, w), (b, v)):
                matrix[i, j] += 1
    return matrix


def directed_matrix(reference, query, length, rotation, tolerance):
    """As above for a full rotation: only the ends that it brings together are counted."""
    matrix = np.zeros((len(reference[0]), len(query[0])), int)
    for a, b, d, _ in edges(*reference):
        for v, w, e, _ in edges(*query):
            if abs(d - e) > length:
                continue
            # The sense of an edge runs from its first to its second end.
            ab = np.arctan2(*(np.float64(reference[0][b]) - np.float64(reference[0][a]))[::-1])
            vw = np.arctan2(*(np.float64(query[0][w]) - np.float64(query[0][v]))[::-1])
            if apart(ab - vw, rotation, 2 * np.pi) <= tolerance:
                matrix[a, v] += 1
                matrix[b, w] += 1
            if apart(ab - vw, rotation + np.pi, 2 * np.pi) <= tolerance:
                matrix[a, w] += 1
                matrix[b, v] += 1
    return matrix


def pose_of_edge(reference, query, a, b, v, w):
    """The motion (x, y, theta) that puts edge (v, w) on (a, b), middle on middle."""
    p, q = np.float64(reference[[a, b]]), np.float64(query[[v, w]])
    theta = np.arctan2(*(p[1] - p[0])[::-1]) - np.arctan2(*(q[1] - q[0])[::-1])
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    return np.array([*(p.mean(axis=0) - turn @ q.mean(axis=0)), theta])


def contributions(reference, query, i, j, length, rotation, tolerance):
    """{b: pose}: edge (i, b) with the query's edge (j, w) closest to it in length."""
    found = {}
    for b in range(len(reference[0])):
        best = None
        for w in range(len(query[0])):
            ends = reference[1][i] and reference[1][b] and query[1][j] and query[1][w]
            if not ends or b == i or w == j:
                continue
            ib = np.float64(reference[0][b]) - np.float64(reference[0][i])
            jw = np.float64(query[0][w]) - np.float64(query[0][j])
            off = abs(np.hypot(*ib) - np.hypot(*jw))
            turn = np.arctan2(*ib[::-1]) - np.arctan2(*jw[::-1])
            if off > length or apart(turn, rotation, 2 * np.pi) > tolerance:
                continue
            if best is None or off < best[0]:
                best = off, pose_of_edge(reference[0], query[0], i, b, j, w)
        if best is not None:
            found[b] = best[1]
    return found


def centre_of_gravity(poses, centre, distance, angle):
    """Mean of the largest cluster of poses and its size.

    Poses are near when they put `centre` to near places and turn it alike; the cluster is what
    is near the first pose with most neighbours.
    """

    def place(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return pose[:2] + np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])

    clusters = [
        [
            q
            for q in poses
            if np.hypot(*(place(p) - place(q))) <= distance
            and apart(p[2], q[2], 2 * np.pi) <= angle
        ]
        for p in poses
    ]
    cluster = max(clusters, key=len)
    turns = [(q[2] - cluster[0][2] + np.pi) % (2 * np.pi) - np.pi for q in cluster]
    theta = cluster[0][2] + np.mean(turns)
    middle = np.mean([place(q) for q in cluster], axis=0)
    c, s = np.cos(theta), np.sin(theta)
    back = np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])
    return np.array([*(middle - back), theta]), len(cluster)
