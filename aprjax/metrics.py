"""How well anchors and matches do, in NumPy."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors
from aprjax.plane import compose, distance, inverse, transform, wrap
from aprjax.result import MatchResult
from aprjax.scan import Scan

RIGHT_DISTANCE, RIGHT_ANGLE = 0.5, np.radians(10)
"""A hypothesis is right within these of the true pose, in metres and radians."""
NEAR_DISTANCE, NEAR_ANGLE = 2.0, np.radians(40)
"""A reference shows a query's place up to these between their true poses, likewise."""


def repeatability(
    anchors_a: Anchors,
    anchors_b: Anchors,
    T_a_b: np.ndarray,
    radius: float = 0.1,
    scan_b: Scan | None = None,
) -> float:
    """Share of the anchors of scan a that scan b of the same place has again; NaN if a has none.

    `T_a_b` `(3,)` is the true pose of b's laser in a's frame, in metres and radians, `radius` is
    in metres. See `reappearing` for what is counted.
    """
    counted, found = reappearing(anchors_a, anchors_b, T_a_b, radius, scan_b)
    return float(found.sum() / counted.sum()) if counted.any() else float("nan")


def reappearing(
    anchors_a: Anchors,
    anchors_b: Anchors,
    T_a_b: np.ndarray,
    radius: float = 0.1,
    scan_b: Scan | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Which anchors of a count, and which of those b has again: two masks `(anchors,)`.

    An anchor of a is there again if any anchor of b, moved by `T_a_b`, lies within `radius`
    metres of it; the kinds may differ, for matching does not look at them. Without `scan_b` all
    valid anchors of a count. With it, a jump edge or an angle counts only if b could see it: it
    lies in b's field of view and within its range limit, and at least one of the three beams
    nearest in bearing is not known to end more than 0.2 m before it. Virtual edges always count:
    they lie on no surface, so nothing says where they could be seen from.
    """
    xy_a, valid_a = np.asarray(anchors_a.xy, float), np.asarray(anchors_a.valid)
    xy_b = np.asarray(anchors_b.xy, float)[np.asarray(anchors_b.valid)]
    gap = xy_a[:, None] - transform(T_a_b, xy_b)
    near = np.any(np.hypot(gap[..., 0], gap[..., 1]) <= radius, axis=1)
    counted = valid_a
    if scan_b is not None:
        virtual = np.asarray(anchors_a.kind) == Kind.VIRTUAL_EDGE
        counted = valid_a & (virtual | _visible(transform(inverse(T_a_b), xy_a), scan_b))
    return counted, counted & near


def _visible(xy: np.ndarray, scan: Scan, margin: float = 0.2) -> np.ndarray:
    """Which points `(points, 2)`, in metres in the laser's frame, a scan could have seen."""
    distance = np.hypot(xy[:, 0], xy[:, 1])
    step, beams = float(scan.angle_increment), int(scan.beams)
    past = (np.arctan2(xy[:, 1], xy[:, 0]) - float(scan.angle_min)) * np.sign(step)
    # Half a beam before the first one is still in view.
    nearest = np.round(np.mod(past + 0.5 * abs(step), 2 * np.pi) / abs(step) - 0.5).astype(int)
    ends = np.where(np.asarray(scan.hit), np.asarray(scan.ranges, float), np.inf)[:beams]
    three = nearest[:, None] + np.array([-1, 0, 1])
    three = three % beams if bool(scan.full_turn) else np.clip(three, 0, beams - 1)
    open_ = np.any(ends[three] > distance[:, None] - margin, axis=1)
    return (nearest < beams) & (distance <= float(scan.range_max)) & open_


def world_poses(result: MatchResult, ids: np.ndarray, T_world_ref: np.ndarray) -> np.ndarray:
    """Where batched results say that the queries were taken: `(queries, K, 3)`.

    `ids` `(references,)` are the references' ids, ascending, in the order of their true poses
    `T_world_ref` `(references, 3)`. Hypotheses that are not valid have poses that mean nothing.
    """
    row = np.minimum(np.searchsorted(ids, np.asarray(result.reference)), len(ids) - 1)
    return compose(T_world_ref[row], np.asarray(result.T_ref_query, float))


def deviations(poses: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances in metres and turns in radians between poses `(..., 3)` of one frame."""
    return distance(poses - truth), np.abs(wrap(poses[..., 2] - truth[..., 2]))


def is_right(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Which poses `(..., 3)` are within `RIGHT_DISTANCE` and `RIGHT_ANGLE` of the truth."""
    gap, turn = deviations(poses, truth)
    return (gap < RIGHT_DISTANCE) & (turn < RIGHT_ANGLE)


def is_near(T_world_a: np.ndarray, T_world_b: np.ndarray) -> np.ndarray:
    """Which scans taken at poses `(..., 3)` show one place: `NEAR_DISTANCE` and `NEAR_ANGLE`."""
    gap, turn = deviations(T_world_a, T_world_b)
    return (gap < NEAR_DISTANCE) & (turn < NEAR_ANGLE)


@dataclass(frozen=True)
class Reliability:
    """Hypotheses by the probability they claim, in bins that hold some."""

    claimed: np.ndarray
    """Mean probability in each bin."""
    right: np.ndarray
    """Share of the right ones in it."""
    count: np.ndarray

    @property
    def error(self) -> float:
        """Expected calibration error: the mean of |claimed - right| over all hypotheses."""
        share = self.count / max(self.count.sum(), 1)
        return float(np.sum(share * np.abs(self.claimed - self.right)))


def reliability(probability: np.ndarray, right: np.ndarray, bins: int = 10) -> Reliability:
    """Compare claimed probabilities `(n,)` with what is `right` `(n,)`, in bins of equal width."""
    probability, right = np.asarray(probability, float), np.asarray(right, float)
    bin_ = np.minimum((probability * bins).astype(int), bins - 1)
    count = np.bincount(bin_, minlength=bins)
    filled = np.flatnonzero(count)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(bin_, values, minlength=bins)[filled] / count[filled]

    return Reliability(mean(probability), mean(right), count[filled])


@dataclass(frozen=True)
class Scores:
    """Shares of the mapped queries, those taken where some reference was."""

    top1: float
    """The best hypothesis is right."""
    oracle: float
    """Some hypothesis is right."""
    hits: float
    """Right best hypotheses that the most generous threshold on e_m accepts with at most one
    wrong, or one in 500."""
    error_m: float
    """Median distance of the right best hypotheses from the truth."""
    error_deg: float


def score_matches(
    result: MatchResult,
    ids: np.ndarray,
    T_world_ref: np.ndarray,
    T_world_query: np.ndarray,
    mapped: np.ndarray,
) -> Scores:
    """Score batched results against true poses `(references, 3)` and `(queries, 3)`.

    `ids` `(references,)` are the references' ids, ascending, in the order of their poses;
    `mapped` `(queries,)` says which queries can be matched. A right answer to a query that is not
    mapped counts neither way; a wrong one is wrong wherever the query was taken. NaN where there
    is nothing to take a share of.
    """
    poses = world_poses(result, ids, T_world_ref)
    gap, turn = deviations(poses, T_world_query[:, None])
    right = np.asarray(result.valid) & is_right(poses, T_world_query[:, None])
    best = right[:, 0]
    answers = best_answers(result, ids, T_world_ref, T_world_query, mapped)
    count = np.sum(mapped)
    with np.errstate(invalid="ignore"):
        return Scores(
            top1=float(np.sum(answers.right) / count),
            oracle=float(np.sum(right.any(axis=1) & mapped) / count),
            hits=answers.accepted(0.002, free=1),
            error_m=float(np.median(gap[best, 0])) if best.any() else float("nan"),
            error_deg=float(np.degrees(np.median(turn[best, 0]))) if best.any() else float("nan"),
        )


@dataclass(frozen=True)
class Answers:
    """Best hypotheses of queries, `(queries,)` each; neither right nor wrong where none counts."""

    quality: np.ndarray
    """e_m."""
    right: np.ndarray
    """Right, and the query is mapped."""
    wrong: np.ndarray
    mapped: np.ndarray

    def accepted(self, false: float, free: int = 0) -> float:
        """Share of the mapped queries that one threshold on e_m accepts and that are right.

        The threshold is the most generous one of which at most the share `false` of what it
        accepts is wrong; so many wrong ones as `free` are let pass in any case. NaN if no query
        is mapped.
        """
        counts = self.right | self.wrong
        order = np.argsort(-self.quality[counts], kind="stable")
        quality = self.quality[counts][order]
        right, wrong = np.cumsum(self.right[counts][order]), np.cumsum(self.wrong[counts][order])
        # A threshold takes equal qualities together.
        last = np.diff(quality, append=-np.inf) != 0
        fits = np.flatnonzero(last & (wrong <= np.maximum(free, false * (right + wrong))))
        found = right[fits[-1]] if len(fits) else 0
        return float(found / np.sum(self.mapped)) if self.mapped.any() else float("nan")


def best_answers(
    result: MatchResult,
    ids: np.ndarray,
    T_world_ref: np.ndarray,
    T_world_query: np.ndarray,
    mapped: np.ndarray,
) -> Answers:
    """The best hypotheses of batched results; the arguments are those of `score_matches`."""
    valid = np.asarray(result.valid)[:, 0]
    right = is_right(world_poses(result, ids, T_world_ref)[:, 0], T_world_query)
    mapped = np.asarray(mapped, bool)
    return Answers(
        quality=np.asarray(result.quality)[:, 0],
        right=valid & right & mapped,
        wrong=valid & ~right,
        mapped=mapped,
    )


def pooled(answers: Sequence[Answers]) -> Answers:
    """Several logs' answers together, for one threshold on all of them."""
    names = [field.name for field in dataclasses.fields(Answers)]
    return Answers(*(np.concatenate([getattr(each, name) for each in answers]) for name in names))
