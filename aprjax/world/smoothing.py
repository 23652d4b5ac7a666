"""Many poses from relative measurements between them: robust least squares on a sparse graph.

Used where a map is built: for the way that the robot drove, in which every scan is measured from
several before it, and for the surroundings of an arc. Gauss-Newton steps with Cauchy weights; a
measurement far off what all others say loses its influence.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from aprjax.plane import relative, wrap

_STEPS = 25
_SCALE = 27.0  # squared standard deviations, over three numbers, at which a weight is one half
_CONVERGED = 1e-5  # metres and radians


@dataclass(frozen=True, eq=False)
class Measurements:
    """Relative poses between numbered ones."""

    first: np.ndarray
    """`(M,)` numbers."""
    second: np.ndarray
    """`(M,)`."""
    T_first_second: np.ndarray
    """`(M, 3)` metres, radians."""
    root: np.ndarray
    """`(M, 3, 3)`: W with Wᵀ W the inverse covariance."""

    @classmethod
    def make(cls, first, second, T_first_second: np.ndarray, covariance: np.ndarray) -> Self:
        """From covariances `(M, 3, 3)`."""
        root = np.linalg.cholesky(np.linalg.inv(covariance)).transpose(0, 2, 1)
        return cls(np.asarray(first), np.asarray(second), T_first_second, root)

    @classmethod
    def join(cls, parts: "list[Measurements]") -> "Measurements":
        """All of them."""
        names = ("first", "second", "T_first_second", "root")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, which: np.ndarray) -> "Measurements":
        """Those under a mask or of these indices."""
        return Measurements(
            self.first[which], self.second[which], self.T_first_second[which], self.root[which]
        )


def smooth(poses: np.ndarray, measured: Measurements, fixed: int = 0) -> np.ndarray:
    """Poses `(N, 3)` that fit the measurements, from the start `poses`; number `fixed` stays."""
    poses = poses.copy()
    for _ in range(_STEPS):
        jacobian, off, weight = _linearised(poses, measured)
        weighed = jacobian.multiply(np.repeat(weight, 3)[:, None]).tocsc()
        step = (
            _solver(jacobian.T @ weighed, fixed, poses.size)
            .solve(-(weighed.T @ off))
            .reshape(-1, 3)
        )
        poses += step
        poses[:, 2] = wrap(poses[:, 2])
        if np.abs(step).max() < _CONVERGED:
            break
    return poses


def relative_covariance(
    poses: np.ndarray, measured: Measurements, first: int, second: int
) -> np.ndarray:
    """`(3, 3)`: how well the measurements hold pose `second` in the frame of pose `first`."""
    jacobian, _, weight = _linearised(poses, measured)
    weighed = jacobian.multiply(np.repeat(weight, 3)[:, None]).tocsc()
    unit = np.zeros((poses.size, 3))
    unit[3 * second + np.arange(3), np.arange(3)] = 1.0
    covariance = _solver(jacobian.T @ weighed, first, poses.size).solve(unit)[
        3 * second : 3 * second + 3
    ]
    cos, sin = np.cos(poses[first, 2]), np.sin(poses[first, 2])
    turned = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    covariance = turned @ covariance @ turned.T
    return 0.5 * (covariance + covariance.T)


def _linearised(poses: np.ndarray, measured: Measurements):
    """Jacobian `(3M, 3N)`, residuals `(3M,)` in standard deviations, Cauchy weights `(M,)`."""
    first, second = poses[measured.first], poses[measured.second]
    seen = relative(first, second)
    gap = seen - measured.T_first_second
    gap[:, 2] = wrap(gap[:, 2])
    off = np.einsum("mij,mj->mi", measured.root, gap)
    weight = 1.0 / (1.0 + (off**2).sum(axis=1) / _SCALE)

    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    of_second = np.zeros((len(first), 3, 3))
    of_second[:, 0, 0], of_second[:, 0, 1] = cos, sin
    of_second[:, 1, 0], of_second[:, 1, 1] = -sin, cos
    of_second[:, 2, 2] = 1.0
    of_first = -of_second
    of_first[:, 0, 2], of_first[:, 1, 2] = seen[:, 1], -seen[:, 0]
    blocks = np.concatenate([measured.root @ of_first, measured.root @ of_second])

    count = len(first)
    axis = np.arange(3)
    rows = np.tile(3 * np.arange(count), 2)[:, None, None] + axis[:, None] + 0 * axis
    numbers = np.concatenate([measured.first, measured.second])
    columns = 3 * numbers[:, None, None] + axis + 0 * axis[:, None]
    shape = (3 * count, 3 * len(poses))
    jacobian = scipy.sparse.csc_matrix(
        (blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape
    )
    return jacobian, off.ravel(), weight


def _solver(information: "scipy.sparse.csc_matrix", fixed: int, size: int):
    """The factors of the normal equations, with one pose held in its place."""
    # Of `scipy`'s parts, the one that is not sure to be there when it is first asked for.
    from scipy.sparse.linalg import splu

    hold = 3 * fixed + np.arange(3)
    pin = scipy.sparse.csc_matrix((np.full(3, 1e8), (hold, hold)), shape=(size, size))
    # Poses that nothing measures stay where they are.
    loose = 1e-6 * scipy.sparse.identity(size, format="csc")
    return splu((information + pin + loose).tocsc())
