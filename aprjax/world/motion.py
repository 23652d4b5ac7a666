"""The way a robot drove: odometry made good by scans that overlap with those before them.

Only local use is made of it. Over a few metres it is good to centimetres; over a long way it
drifts as any dead reckoning does, and recognition has to close the cycles.
"""

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.evaluation.view import View
from aprjax.plane import compose, distance, relative, wrap
from aprjax.world.alignment import AlignConfig, Aligned, Expected, align_pairs
from aprjax.world.smoothing import Measurements, smooth

_TURNS = np.array([0, -0.6, 0.6, -1.2, 1.2, -2.2, 2.2, -3.2, 3.2])  # deviations of odometry
_FEW_TURNS = np.radians([0, -6, 6])
_SKID = np.radians(8)  # at least for that: wheels may slip on the spot
NARROW_TURNS = np.radians([0, -4, 4])
"""Turns of the starts where the relative pose is known from other scans."""
_OFF = 1.5  # deviations of odometry that starts lie off it
_FARTHEST_STEP = 1000.0  # metres
_LAGS = (1.0, 2.0, 3.0)  # metres of way between scans that are aligned besides neighbours


class MotionConfig(eqx.Module):
    """The errors of odometry, and when aligned scans say more."""

    align: AlignConfig = AlignConfig()
    slip: Float[Array, ""] = threshold(0.03, "metres: odometry of a step, at rest")
    slip_per_metre: Float[Array, ""] = threshold(0.08, "metres that way adds to it")
    slip_per_turn: Float[Array, ""] = threshold(0.03, "metres that a radian adds")
    turn: Float[Array, ""] = threshold(np.radians(1.0), "radians: odometry of a step, at rest")
    turn_per_metre: Float[Array, ""] = threshold(0.04, "radians that way adds to it")
    turn_per_turn: Float[Array, ""] = threshold(0.1, "radians that a radian adds")
    agreement: Float[Array, ""] = threshold(0.03, "least agreement of an aligned pair that counts")
    firm: Float[Array, ""] = threshold(0.25, "agreement below which a pair is doubted")
    loose: Float[Array, ""] = threshold(
        0.6, "metres: deviation of odometry from which a pair below that does not count at all"
    )
    floor: Float[Array, ""] = threshold(0.015, "metres: least deviation of an aligned pair")
    turn_floor: Float[Array, ""] = threshold(np.radians(0.25), "radians: the same")


@dataclass(frozen=True, eq=False)
class Motion:
    """A driven way, scan by scan."""

    poses: np.ndarray
    """`(N, 3)` in a frame that drifts: only poses of scans close to each other on the way mean
    anything to each other."""
    covariance: np.ndarray
    """`(N, 3, 3)` of the step to each scan from the one before; zero for the first."""
    way: np.ndarray
    """`(N,)` metres driven until each scan."""
    measured: Measurements
    """Odometry's steps, first of all, and the aligned pairs that agree."""

    def step(self, first: int, second: int) -> np.ndarray:
        """`T_first_second` `(3,)`."""
        return relative(self.poses[first], self.poses[second])

    def turn(self, scan: int, about: float) -> float:
        """Radians by which the robot turned within `about` metres of a scan, one step at least."""
        way = self.way[scan] + np.array([-about, about])
        first, last = np.searchsorted(self.way, way)
        first, last = max(min(first, scan - 1), 0), min(max(last, scan + 1), len(self.way) - 1)
        return float(np.abs(wrap(np.diff(self.poses[first : last + 1, 2]))).sum())

    def skew(self) -> np.ndarray:
        """`(N,)` radians by which each scan is turned against odometry before it and after it.

        A scan that was taken at another moment of a turn than its odometry is; an error of odometry
        is not made good by the next step.
        """
        steps = len(self.poses) - 1
        turns = wrap(np.diff(self.poses[:, 2]))
        off = wrap(self.measured.T_first_second[:steps, 2] - turns)
        both = np.where(off[:-1] * off[1:] < 0, np.minimum(np.abs(off[:-1]), np.abs(off[1:])), 0.0)
        return np.pad(both, (1, min(steps, 1)))[: steps + 1]

    def heading_deviation(self) -> np.ndarray:
        """`(N,)` radians: how well all that was measured of each scan holds its heading."""
        information = np.zeros(len(self.poses))
        if len(self.measured.first):
            square = np.einsum("mji,mjk->mik", self.measured.root, self.measured.root)
            of_heading = 1.0 / np.linalg.inv(square)[:, 2, 2]
            np.add.at(information, self.measured.first, of_heading)
            np.add.at(information, self.measured.second, of_heading)
        return 1.0 / np.sqrt(np.maximum(information, 1e-12))


def motion(views: View, odometry: np.ndarray, config: MotionConfig) -> Motion:
    """The way of the scans of `views` `(scans,)`, from odometry poses `(N, 3)`.

    Every scan is aligned with the one before it and with those about one, two and three metres
    before it; all that agree, and odometry, are weighed in one robust least-squares problem.
    """
    count = len(odometry)
    steps = _believable(relative(odometry[:-1], odometry[1:]))
    covariance = _odometry_covariance(steps, config)
    of_odometry = Measurements.make(np.arange(count - 1), np.arange(1, count), steps, covariance)
    measured = [of_odometry]
    if count == 1:
        return Motion(odometry.copy(), np.zeros((1, 3, 3)), np.zeros(1), of_odometry)

    pairs = np.arange(count - 1), np.arange(1, count)
    expected = Expected(steps, of_odometry.root)
    starts = _wide(steps, covariance)
    alike = np.ones(starts.shape[1])
    aligned = align_pairs(views, *pairs, starts, alike, config.align, expected)
    # Where odometry leaves the choice of where to look, something alike is found too easily.
    loose = np.sqrt(2 * covariance[:, 0, 0]) > config.loose
    good = aligned.agreement > np.where(loose, config.firm, config.agreement)
    taken = Aligned(*(array[good] for array in aligned))
    measured.append(agreeing(pairs[0][good], pairs[1][good], taken, config))
    followed = np.where(good[:, None], aligned.T_first_second, steps)
    poses = [np.zeros(3)]
    for step in followed:
        poses.append(compose(poses[-1], step))
    poses = smooth(np.array(poses), Measurements.join(measured))

    done = {(k, k + 1) for k in range(count - 1)}
    for lag in _LAGS:
        way = _way(poses)
        before = np.searchsorted(way, way - lag, side="right") - 1
        pairs = [
            (a, b) for b, a in enumerate(before.tolist()) if a >= 0 and (a, b) not in done and a < b
        ]
        if not pairs:
            continue
        done.update(pairs)
        first, second = np.array(pairs).T
        starts = turned(relative(poses[first], poses[second]), NARROW_TURNS)
        aligned = align_pairs(views, first, second, starts, np.ones(3), config.align)
        measured.append(agreeing(first, second, aligned, config))
        poses = smooth(poses, Measurements.join(measured))
    together = Measurements.join(measured)
    return Motion(poses, _step_covariance(count, together), _way(poses), together)


def agreeing(
    first: np.ndarray, second: np.ndarray, aligned: Aligned, config: MotionConfig
) -> Measurements:
    """The pairs that agree, their covariance the wider the less they do."""
    good = aligned.agreement > config.agreement
    return Measurements.make(
        first[good],
        second[good],
        aligned.T_first_second[good],
        doubted(aligned.covariance[good], aligned.agreement[good], config),
    )


def doubted(covariance: np.ndarray, agreement: np.ndarray, config: MotionConfig) -> np.ndarray:
    """Covariances `(..., 3, 3)` of aligned pairs with what their agreement `(...)` makes of them.

    The covariance takes the pairing of points for granted; where little agrees, it may be wrong.
    """
    floor = np.diag(np.square([config.floor, config.floor, config.turn_floor]).astype(float))
    doubt = 1.0 + 0.5 * (float(config.firm) / np.maximum(agreement, 0.01)) ** 2
    return (covariance + floor) * np.asarray(doubt)[..., None, None]


def turned(poses: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Starts `(..., turns, 3)`: each pose `(..., 3)` turned about its own origin.

    `turns` `(turns,)` or `(..., turns)` are radians.
    """
    starts = np.repeat(poses[..., None, :], np.shape(turns)[-1], axis=-2)
    starts[..., 2] += turns
    return starts


def _wide(steps: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Starts `(..., S, 3)` for steps `(..., 3)` that only odometry knows.

    As far ahead, back, aside and turned as odometry may be off; and at rest or the other way, since
    some robots' wheels count alike in both directions.
    """
    off = _OFF * np.sqrt(covariance[:, 0, 0])
    turns = np.maximum(np.sqrt(covariance[:, 2, 2]), _SKID)[:, None] * _TURNS
    aside = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], float)
    starts = [turned(steps + off[:, None] * way, turns) for way in aside]
    starts += [turned(steps * [share, share, 1.0], _FEW_TURNS) for share in (0.0, -1.0)]
    return np.concatenate(starts, axis=1)


def _believable(steps: np.ndarray) -> np.ndarray:
    """Steps `(..., 3)`, none longer than any that odometry measures.

    Their deviations grow with them, and numbers that differ by too much cannot be weighed in one
    problem. What is left of such a step is as uncertain as to say nothing.
    """
    shorter = np.minimum(1.0, _FARTHEST_STEP / np.maximum(distance(steps), _FARTHEST_STEP))
    return steps * np.stack([shorter, shorter, np.ones_like(shorter)], axis=-1)


def _odometry_covariance(steps: np.ndarray, config: MotionConfig) -> np.ndarray:
    way, turn = distance(steps), np.abs(steps[:, 2])
    slip = config.slip + config.slip_per_metre * way + config.slip_per_turn * turn
    turning = config.turn + config.turn_per_metre * way + config.turn_per_turn * turn
    covariance = np.zeros((len(steps), 3, 3))
    covariance[:, 0, 0] = covariance[:, 1, 1] = slip**2
    covariance[:, 2, 2] = turning**2
    return covariance


def _step_covariance(count: int, measured: Measurements) -> np.ndarray:
    """Of each step, from all measurements that span it, each shared out among its steps."""
    information = np.zeros((count, 3, 3))
    of_each = np.einsum("mji,mjk->mik", measured.root, measured.root)
    span = measured.second - measured.first
    for ahead in range(int(span.max())):
        spans = span > ahead
        shared = of_each[spans] / span[spans][:, None, None]
        np.add.at(information, measured.first[spans] + ahead + 1, shared)
    covariance = np.zeros((count, 3, 3))
    covariance[1:] = np.linalg.inv(information[1:])
    return covariance


def _way(poses: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(distance(np.diff(poses, axis=0)))])
