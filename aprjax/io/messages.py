"""The lines of CARMEN logs: from the words of a message to its numbers."""

import math
from dataclasses import dataclass

import numpy as np

from aprjax.io.files import MOST_BEAMS
from aprjax.scan import WIDEST

LASERS = (
    *("ROBOTLASER1", "FLASER", "RAWLASER1"),
    *("ROBOTLASER2", "RLASER", "RAWLASER2"),
    *("LASER3", "RAWLASER3", "LASER4", "RAWLASER4"),
)
"""Laser messages, the preferred one first: the same scans are often logged as two of them."""

# The old laser messages state no angles; PARAM lines may, under these names.
_OLD_LASERS = {
    "FLASER": "front_laser",
    "RLASER": "rear_laser",
    "LASER3": "laser3",
    "LASER4": "laser4",
}
FARTHEST = 1e15
"""Of poses and stamps: differences and sums of what is not larger are finite."""
_NARROWEST = 1e-6  # radians that the readings of a line cover
OTHER_KINDS = ("ODOM", "PARAM", "VERTEX2", "EDGE2", "TRUEPOS", "SYNC")


@dataclass(frozen=True, eq=False)
class Sweep:
    """A laser line, its ranges as logged; None for what its kind does not state."""

    ranges: np.ndarray
    start: float
    resolution: float
    maximum: float | None
    laser_pose: np.ndarray | None
    robot_pose: np.ndarray | None
    stamp: float


def parse(kind: str, words: list[str], params: dict[str, float]) -> Sweep | np.ndarray | None:
    """A laser line's sweep, an ODOM line's pose; None for other kinds. PARAMs go into `params`.

    Raises `ValueError` that says what is damaged.
    """
    if kind in _OLD_LASERS:
        return _old_sweep(kind, words, params)
    if kind in LASERS:
        return _sweep(words, robot=kind.startswith("ROBOT"))
    if kind == "ODOM":
        _expect(words, at_least=10)
        return _pose(words[1:4])
    if kind == "PARAM":
        _keep_param(words[1:3], params)
    elif kind == "VERTEX2":
        _expect(words, at_least=5)
        _pose(words[2:5])
    elif kind == "EDGE2":
        _expect(words, at_least=6)
        _pose(words[3:6])
    return None


def _keep_param(name_value: list[str], params: dict[str, float]) -> None:
    """Keep a positive number under its name; other values state no resolution and no maximum."""
    try:
        name, value = name_value[0], float(name_value[1])
    except (IndexError, ValueError):
        return
    if 0 < value < math.inf:
        # Old logs write laser_frontlaser_resolution for laser_front_laser_resolution.
        params[name.replace("frontlaser", "front_laser").replace("rearlaser", "rear_laser")] = value


def _old_sweep(kind: str, words: list[str], params: dict[str, float]) -> Sweep:
    """NAME n ranges, laser x y theta, odometry x y theta, time host time."""
    n = _count(words, 1)
    _expect(words, 2 + n + 9)
    name, turn = _OLD_LASERS[kind], max(n - 1, 1)
    resolution = params.get(f"laser_{name}_resolution", 0.0)
    if not math.degrees(_NARROWEST) < resolution * turn <= 360:
        resolution = 180 / (turn if n % 2 else n)
    return Sweep(
        ranges=_numbers(words[2 : 2 + n]),
        start=-math.pi / 2,
        resolution=math.radians(resolution),
        maximum=params.get(f"robot_{name}_max"),
        laser_pose=_pose(words[2 + n : 5 + n]),
        robot_pose=None,
        stamp=_pose(words[8 + n : 9 + n])[0],
    )


def _sweep(words: list[str], *, robot: bool) -> Sweep:
    """NAME type start fov resolution maximum accuracy mode n ranges m remissions, then the tail.

    The tail is time host time, before it for ROBOTLASER laser x y theta, robot x y theta and five
    numbers more.
    """
    n = _count(words, 8)
    m = _count(words, 9 + n, least=0)
    tail = 10 + n + m
    _expect(words, tail + (14 if robot else 3))
    start, _, resolution, maximum = _numbers(words[2:6]).tolist()
    with np.errstate(over="ignore"):
        step = abs(float(np.float32(resolution)))  # as the scan will have it
    turn = step * max(n - 1, 1)
    if not (abs(start) <= 2 * math.pi and _NARROWEST < turn <= WIDEST):
        raise ValueError(f"{n} readings from {start} rad at {resolution} rad are no field of view")
    return Sweep(
        ranges=_numbers(words[9 : 9 + n]),
        start=start,
        resolution=resolution,
        maximum=maximum,
        laser_pose=_pose(words[tail : tail + 3]) if robot else None,
        robot_pose=_pose(words[tail + 3 : tail + 6]) if robot else None,
        stamp=_pose(words[-3:-2])[0],
    )


def _count(words: list[str], index: int, least: int = 1) -> int:
    _expect(words, at_least=index + 1)
    word = words[index]
    if not (word.isdecimal() and len(word) < 10 and int(word) >= least):
        raise ValueError(f"{word[:20]!r} is not a count of readings")
    if int(word) > MOST_BEAMS:
        raise ValueError(f"{word} readings are more than {MOST_BEAMS}")
    return int(word)


def _expect(words: list[str], exactly: int | None = None, *, at_least: int = 0) -> None:
    if len(words) < at_least or exactly not in (None, len(words)):
        raise ValueError(f"{words[0]} has {len(words)} fields, not {exactly or at_least}")


def _numbers(words: list[str]) -> np.ndarray:
    try:
        return np.array(list(map(float, words)))
    except ValueError as error:
        raise ValueError(f"not a number: {str(error).partition(': ')[2][:20]}") from None


def _pose(words: list[str]) -> np.ndarray:
    pose = _numbers(words)
    if not np.isfinite(pose).all():
        raise ValueError(f"not finite: {' '.join(words)}")
    if (abs(pose) > FARTHEST).any():
        raise ValueError(f"too large: {' '.join(words)}")
    return pose
