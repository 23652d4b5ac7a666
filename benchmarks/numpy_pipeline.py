"""One query against one reference in plain NumPy: the tests' oracles, put together.

q_m, matching angles, correspondence matrices, clustering, refinement and synthetic scans with
`aprjax`'s defaults, with no cascade and no last solve; as many maxima of each rotation's matrix as
`aprjax` takes on average. Written to be read: loops over edges, beams and pieces of surface, none
of them optimised.
"""

from types import SimpleNamespace

import numpy as np

import aprjax
from aprjax.configuration import to_dict
from benchmarks.numpy_extraction import FEATURES
from tests.oracles import alignment, evaluation, relations

MATCH = to_dict(aprjax.MatchConfig())


def match(reference: SimpleNamespace, query: SimpleNamespace) -> tuple[np.ndarray, float, float]:
    """`T_ref_query` of the best alternative in metres and radians, its e_m, and q_m."""
    rules, relation = MATCH["alignment"], FEATURES["relation"]
    part = relation["bin_length"] / relation["parts"]
    ours, theirs = ([int(edge[2] / part) for edge in scan.edges] for scan in (query, reference))
    count = relations.count(ours, theirs, relation["part_tolerance"])
    q_m = relations.quality(count, len(ours), len(theirs))
    bins = relation["direction_bins"]
    ours, theirs = (
        [(int(d / relation["bin_length"]), int(a / np.pi * bins)) for _, _, d, a in scan.edges]
        for scan in (query, reference)
    )
    angles = relations.matching_angles(ours, theirs, bins, relation["length_tolerance"])
    poses = [pose for turn in _peaks(angles) for pose in _aligned(reference, query, turn, rules)]
    settled = [_settled(reference, query, pose, MATCH["refine"]) for pose in poses]
    graded = [(_e_m(reference, query, pose), tuple(pose)) for pose in settled]
    e_m, pose = max(graded, default=(0.0, (0.0, 0.0, 0.0)))
    return np.array(pose), e_m, q_m


def _peaks(angles: np.ndarray) -> list[float]:
    """The likely rotations in radians, most votes first."""
    rules = MATCH["alignment"]["rotation"]
    width, bins, found = rules["width"], len(angles), []
    votes = np.sum([np.roll(angles, -shift) for shift in range(-width, width + 1)], axis=0)
    for _ in range(rules["peaks"]):
        peak = int(np.argmax(votes))
        near = np.arange(peak - width, peak + width + 1)
        weight = angles[near % bins]
        if weight.sum():
            angle = float(weight @ near / weight.sum() * np.pi / bins)
            found += [angle, angle + np.pi]
        votes[np.arange(peak - 2 * width, peak + 2 * width + 1) % bins] = 0
    return found


def _aligned(reference, query, turn: float, rules: dict) -> list[np.ndarray]:
    """Alternatives of one rotation: maxima of its matrix, each clustered to a pose."""
    same = rules["correspondence"]["length"], turn, rules["correspondence"]["angle"]
    matrix = alignment.directed_matrix(reference.graph, query.graph, *same)
    centre, found = query.graph[0].mean(axis=0) if len(query.graph[0]) else np.zeros(2), []
    for _ in range(rules["maxima"] // 4):
        if not matrix.any():
            break
        i, j = np.unravel_index(np.argmax(matrix), matrix.shape)
        matrix[i, j] = 0
        poses = list(alignment.contributions(reference.graph, query.graph, i, j, *same).values())
        if not poses:
            continue
        cluster = rules["cluster"]
        size = cluster["distance"], cluster["angle"]
        pose, _ = alignment.centre_of_gravity(poses, centre, *size)
        agree = _agreement(reference, query, pose)
        matrix[agree] = 0
        if agree.any(axis=0).sum() >= rules["min_anchors"]:
            found.append(pose)
    return found


def _agreement(reference, query, pose) -> np.ndarray:
    """Which anchors of the reference and of the query come to lie together."""
    gap = reference.graph[0][:, None] - _moved(pose, query.graph[0])
    return np.hypot(gap[..., 0], gap[..., 1]) <= MATCH["alignment"]["agreement"]


def _moved(pose, xy: np.ndarray) -> np.ndarray:
    """Points in the frame that `pose` is in."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return xy @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def _settled(reference, query, pose, rules: dict) -> np.ndarray:
    """The pose after point-to-line steps with ever smaller gates."""
    xy = query.xy[query.hit]
    xy = xy[:: -(-len(xy) // rules["points"])]
    shrink = rules["final_gate"] / rules["gate"]
    for step in np.linspace(0, 1, rules["iterations"]):
        gate = rules["gate"] * shrink**step
        moved = _moved(pose, xy)
        index, visible = evaluation.look_up(reference, moved)
        gap, normal = moved - reference.xy[index], reference.normal[index]
        near = visible & normal.any(axis=1) & (np.hypot(*gap.T) < rules["reach"] * gate)
        off = (normal * gap).sum(axis=1)
        weight = np.where(near, np.maximum(1 - (off / gate) ** 2, 0) ** 2, 0.0)
        arm = moved - pose[:2]
        turning = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
        columns = np.column_stack([normal, turning])
        information = np.eye(3) + columns.T @ (weight[:, None] * columns)
        pose = pose - np.linalg.solve(information, columns.T @ (weight * off))
    return pose


def _e_m(reference, query, T_ref_query) -> float:
    """The quality of an alignment."""
    T_query_ref, rules = evaluation.inverse(T_ref_query), MATCH["congruence"]["quality"]
    consistent, extents, sees = [], [], []
    for overview, front, T in (
        (reference, query, T_query_ref),
        (query, reference, T_ref_query),
    ):
        agree, contradict, hits, extent = _verdicts(overview, front, T)
        against = rules["contradiction"] * contradict + rules["doubt"] * hits
        share = (1 + rules["doubt"]) * agree / max(agree + against, 1)
        place = evaluation.inverse(T)[:2]
        (index,), (visible,) = evaluation.look_up(overview, [place])
        consistent.append(min(share, 1.0))
        extents.append(extent)
        sees.append(bool(visible and overview.range[index] > np.hypot(*place)))
    if sees[0] != sees[1]:
        consistent = [consistent[sees.index(True)]] * 2
    number = _agreement(reference, query, T_ref_query).any(axis=0).sum()
    extent = np.mean(extents)
    factors = number / (number + rules["anchors"]), extent / (extent + rules["extent"])
    return float(np.prod([*consistent, *factors]))


def _verdicts(overview, front, T_front_overview) -> tuple[int, int, int, float]:
    """Beams that agree, contradict and hit, and the extent of those that agree in metres."""
    beams = np.flatnonzero(front.hit)
    claimed = evaluation.synthetic_ranges(
        overview, T_front_overview, front.angle_min + beams * front.angle_increment
    )
    measured = front.range[beams]
    rules = MATCH["congruence"]
    tolerance = rules["tolerance"] + rules["relative"] * measured
    seen = _moved(evaluation.inverse(T_front_overview), front.xy[beams])
    index, visible = evaluation.look_up(overview, seen)
    agree = np.abs(measured - claimed) <= tolerance
    free = visible & overview.hit[index]
    free &= overview.range[index] > np.hypot(*seen.T) + tolerance
    contradict = ~agree & ((measured > claimed) | free)
    extent = np.sqrt(front.xy[beams][agree].var(axis=0).sum()) if agree.any() else 0.0
    return int(agree.sum()), int(contradict.sum()), len(beams), float(extent)
