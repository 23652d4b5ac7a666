"""Trajectories as text in TUM's format, a pose a line: stamp x y z qx qy qz qw."""

import math
import os
from pathlib import Path

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.io.files import open_file

_FIELDS = 8
_UNIT = 0.01  # how far from 1 the length of a quaternion may be


class TrajectoryError(ValueError):
    """A trajectory file that cannot be used. One line: the path, the line number, and why."""


def write_tum(path: str | os.PathLike[str], stamps: np.ndarray, poses: np.ndarray) -> None:
    """Write `stamps` `(N,)` in seconds and `poses` `(N, 3)` in metres and radians.

    Stamps have six decimals, all else nine: nanometres and nanoradians. Complete or not there: see
    `atomic_write`. Raises `ValueError` naming the field, the index and the value where the
    shapes do not fit or a number is not finite, and `OSError`.
    """
    stamps, poses = np.asarray(stamps, float), np.asarray(poses, float)
    for name, value, shape in (
        ("stamps", stamps, stamps.shape[:1]),
        ("poses", poses, (len(stamps), 3)),
    ):
        if value.shape != shape:
            raise ValueError(f"{name}: shape {value.shape} is not {shape}")
        for index in np.argwhere(~np.isfinite(value))[:1]:
            raise ValueError(f"{name}{index.tolist()}: {value[tuple(index)]} is not finite")
    with atomic_write(path) as file:
        file.write("# stamp x y z qx qy qz qw\n")
        for stamp, (x, y, theta) in zip(stamps, poses, strict=True):
            qz, qw = np.sin(theta / 2), np.cos(theta / 2)
            file.write(f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 {qz:.9f} {qw:.9f}\n")


def read_tum(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps `(N,)` in seconds and poses `(N, 3)` in metres and radians, as `write_tum` has them.

    Headings are in [-π, π]. Comments and empty lines are skipped; of a trajectory in space, what
    is seen from above is left. Raises `TrajectoryError` for a file that cannot be read or holds
    no pose, and for a line that is not eight finite numbers, the last four a quaternion of
    length 1.
    """
    path = Path(path)
    try:
        with open_file(path) as file:
            lines = file.read().decode(errors="replace").splitlines()
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror or error}") from None
    rows = []
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            try:
                rows.append(_numbers(words))
            except ValueError as error:
                raise TrajectoryError(f"{path}: line {number}: {error}") from None
    if not rows:
        raise TrajectoryError(f"{path}: no pose in {len(lines)} lines")
    stamps, x, y, _, qx, qy, qz, qw = np.array(rows).T
    theta = np.arctan2(2 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return stamps, np.stack([x, y, theta], axis=-1)


def _numbers(words: list[str]) -> list[float]:
    if len(words) != _FIELDS:
        raise ValueError(f"{len(words)} fields, not {_FIELDS}: {' '.join(words)[:40]}")
    numbers = []
    for word in words:
        try:
            numbers.append(float(word))
        except ValueError:
            raise ValueError(f"{word[:20]!r} is not a number") from None
        if not np.isfinite(numbers[-1]):
            raise ValueError(f"{word[:20]} is not finite")
    length = math.hypot(*numbers[4:])
    if abs(length - 1) > _UNIT:
        raise ValueError(f"the quaternion {' '.join(words[4:])} has length {length:.3g}, not 1")
    return numbers
