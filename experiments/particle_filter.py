"""A particle filter to compare with: Monte Carlo localization on an occupancy grid.

Fox, Burgard, Dellaert, Thrun, Monte Carlo Localization: Efficient Position Estimation for Mobile
Robots, AAAI 1999, with the likelihood field and the random injection of augmented MCL (Thrun,
Burgard, Fox, Probabilistic Robotics, 2005, 6.4 and 8.3.5): without the latter it never recovers
from a kidnapping. The grid is drawn from the reference scans at their true poses, which APR is
never told.
"""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from aprjax.io.log import LogEntry
from aprjax.plane import compose, transform
from aprjax.scan import Scan
from aprjax.tracking.continuity import end_points
from aprjax.tracking.odometry import WheelOdometry

CELL = 0.05  # metres
BEAMS = 45  # of a scan, at most
DEVIATION, RANDOM = 0.15, 0.1  # metres; weight of measurements of anything
TEMPER = 0.1  # power of a scan's likelihood: its beams do not err independently
SLOW, FAST = 0.05, 0.5  # rates of the two averages of the likelihood whose ratio injects particles
NEAR, TURNED = 0.5, np.radians(10)  # of the strongest place: particles that agree with it


@dataclass(frozen=True)
class LikelihoodField:
    """Where scans end, and where the robot may be, on one grid."""

    origin: np.ndarray
    """`(2,)` metres, of the lowest cell's corner."""
    likelihood: np.ndarray
    """`(columns, rows)`: log-likelihood of a beam that ends there."""
    free: np.ndarray
    """`(cells, 2)`: centres of the cells that some reference saw free."""

    @classmethod
    def of(cls, scans: list[Scan], T_world_laser: np.ndarray) -> "LikelihoodField":
        """The field of scans at their true poses `(scans, 3)`."""
        rays = [end_points(scan, 10_000) for scan in scans]
        ends = [transform(pose, xy) for pose, xy in zip(T_world_laser, rays, strict=True)]
        low, high = (f([f(xy, axis=0) for xy in ends], axis=0) for f in (np.min, np.max))
        origin = low - 1.0
        shape = tuple(((high - origin + 1.0) / CELL).astype(int))
        occupied, seen = np.zeros(shape, bool), np.zeros(shape, bool)
        for pose, xy in zip(T_world_laser, ends, strict=True):
            occupied[tuple(((xy - origin) / CELL).astype(int).T)] = True
            along = np.linspace(0.0, 0.95, 120)[:, None, None]
            passed = (pose[:2] + along * (xy - pose[:2])).reshape(-1, 2)
            seen[tuple(((passed - origin) / CELL).astype(int).T)] = True
        gap = CELL * np.asarray(distance_transform_edt(~occupied))
        hit = (1 - RANDOM) * np.exp(-0.5 * (gap / DEVIATION) ** 2)
        free = origin + CELL * (np.argwhere(seen & (gap > 0.2)) + 0.5)
        return cls(origin, np.log(hit + RANDOM).astype(np.float32), free)

    def of_ends(self, xy: np.ndarray) -> np.ndarray:
        """Log-likelihoods of end points `(..., 2)`; off the grid, those of anything."""
        cell = ((xy - self.origin.astype(np.float32)) * np.float32(1 / CELL)).astype(np.int32)
        columns, rows = self.likelihood.shape
        x, y = cell[..., 0], cell[..., 1]
        inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
        index = np.where(inside, x * rows + y, 0)
        return np.where(inside, self.likelihood.ravel()[index], np.float32(np.log(RANDOM)))


class ParticleFilter:
    """Poses `(particles, 3)` with weights, moved by odometry and weighed by scans."""

    def __init__(self, field: LikelihoodField, particles: int, seed: int) -> None:
        """Uniform over the free cells and all headings."""
        self._field, self._rng = field, np.random.default_rng(seed)
        self._model = WheelOdometry()
        self.poses = self._anywhere(particles)
        self.weights = np.full(particles, 1.0 / particles)
        self._slow = self._fast = 0.0

    def follow(self, entries: Iterable[LogEntry]) -> Iterator[tuple[np.ndarray, float, float]]:
        """After each entry the strongest pose, the weight about it, and seconds of CPU time."""
        for entry in entries:
            began = time.process_time()
            if entry.odometry is not None:
                self.move(entry.odometry)
            self.observe(entry.scan)
            pose, weight = self.strongest()
            yield pose, weight, time.process_time() - began

    def move(self, odometry: np.ndarray) -> None:
        """Carried on by a step of wheel odometry, each with noise of its own."""
        step = self._model.step(odometry, None)
        if step is not None:
            noise = np.sqrt(np.diag(step.covariance)) * self._rng.normal(size=self.poses.shape)
            self.poses = compose(self.poses, step.T_before_now + noise)

    def observe(self, scan: Scan) -> None:
        """Weighed by a scan; drawn anew where few are left, some of them anywhere."""
        xy = end_points(scan, BEAMS).astype(np.float32)
        if not len(xy):
            return
        cos, sin = (f(self.poses[:, 2]).astype(np.float32)[:, None] for f in (np.cos, np.sin))
        place = self.poses[:, :2].astype(np.float32)
        ends = np.stack(
            [
                place[:, :1] + cos * xy[:, 0] - sin * xy[:, 1],
                place[:, 1:] + sin * xy[:, 0] + cos * xy[:, 1],
            ],
            axis=-1,
        )
        fit = self._field.of_ends(ends).sum(axis=1).astype(float)
        # The mean of a beam, so that the averages do not underflow.
        mean = float(np.sum(self.weights * np.exp(fit / len(xy))))
        self._slow += SLOW * (mean - self._slow) if self._slow else mean
        self._fast += FAST * (mean - self._fast) if self._fast else mean
        self.weights = self.weights * np.exp(TEMPER * (fit - fit.max()))
        self.weights /= self.weights.sum()
        lost = max(0.0, 1.0 - self._fast / self._slow)
        if lost > 0 or 1.0 / np.sum(self.weights**2) < 0.5 * len(self.weights):
            self._draw_anew(lost)

    def strongest(self) -> tuple[np.ndarray, float]:
        """The pose `(3,)` with most weight about it, and that weight."""
        cell = np.floor(self.poses / [NEAR, NEAR, 2 * TURNED]).astype(np.int64)
        cell -= cell.min(axis=0)
        wide = cell.max(axis=0) + 1
        key = (cell[:, 0] * wide[1] + cell[:, 1]) * wide[2] + cell[:, 2]
        _, number = np.unique(key, return_inverse=True)
        heaviest = number == np.argmax(np.bincount(number, self.weights))
        centre = self._mean(heaviest)
        off = np.hypot(*(self.poses[:, :2] - centre[:2]).T)
        turn = np.abs(np.mod(self.poses[:, 2] - centre[2] + np.pi, 2 * np.pi) - np.pi)
        agreeing = (off < NEAR) & (turn < TURNED)
        return self._mean(agreeing), float(self.weights[agreeing].sum())

    def _mean(self, chosen: np.ndarray) -> np.ndarray:
        weights, poses = self.weights[chosen], self.poses[chosen]
        weights = weights / weights.sum()
        heading = np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
        return np.array([*(weights @ poses[:, :2]), heading])

    def _draw_anew(self, anywhere: float) -> None:
        """Low-variance resampling, a share of the particles anywhere."""
        count = len(self.weights)
        at = (np.arange(count) + self._rng.random()) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), at), count - 1)
        self.poses = self.poses[chosen]
        new = self._rng.random(count) < anywhere
        self.poses[new] = self._anywhere(int(new.sum()))
        self.weights = np.full(count, 1.0 / count)

    def _anywhere(self, count: int) -> np.ndarray:
        cells = self._field.free[self._rng.integers(len(self._field.free), size=count)]
        xy = cells + CELL * self._rng.uniform(-0.5, 0.5, (count, 2))
        return np.column_stack([xy, self._rng.uniform(-np.pi, np.pi, count)])
