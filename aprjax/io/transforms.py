"""Frames and the transforms between them, as ROS's tf has them."""

import math
from array import array

import numpy as np

from aprjax.io.messages import FARTHEST


class TransformTree:
    """The transforms of a bag: of each frame, where it is in its parent."""

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._first: dict[str, np.ndarray] = {}
        self._track: dict[str, array] = {}

    @property
    def frames(self) -> set[str]:
        """All frames, parents included."""
        return {*self._parent, *self._parent.values()}

    def add(self, parent: str, child: str, stamp: float, T: np.ndarray, *, static: bool) -> None:
        """Take a transform `T` `(4, 4)` of `child` in `parent`. The first parent stays."""
        if self._parent.setdefault(child, parent) != parent:
            return
        self._first.setdefault(child, T)
        if not static:
            self._track.setdefault(child, array("d")).extend((stamp, *planar(T)))

    def above(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the top; each once, even in a ring."""
        chain = [frame]
        while (parent := self._parent.get(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def mounted_on(self, frame: str) -> str:
        """The highest frame above a frame that it does not move in."""
        for child in self.above(frame):
            if child in self._track or child not in self._parent:
                return child
        return frame

    def between(self, base: str, frame: str) -> np.ndarray | None:
        """`(4, 4)`: the first known pose of `frame` in `base`; None if no transforms join them."""
        up, down = self.above(base), self.above(frame)
        common = next((each for each in down if each in up), None)
        if common is None:
            return None
        T_common_base, T_common_frame = (
            self._chained(chain[: chain.index(common)]) for chain in (up, down)
        )
        return np.linalg.inv(T_common_base) @ T_common_frame

    def below(self, parent: str) -> tuple[str, np.ndarray] | None:
        """The moving child of a frame of this name, and its track `(N, 4)`: stamp, x, y, theta."""
        for child, track in self._track.items():
            if self._parent[child].split("/")[-1] == parent:
                return child, np.array(track).reshape(-1, 4)
        return None

    def _chained(self, frames: list[str]) -> np.ndarray:
        T = np.eye(4)
        for frame in frames:
            T = self._first[frame] @ T
        return T


def pose_matrix(
    translation: tuple[float, float, float], rotation: tuple[float, float, float, float]
) -> np.ndarray:
    """`(4, 4)` of a translation and a quaternion x, y, z, w.

    Raises `ValueError` for a number that is not finite or too large and a quaternion of length
    zero.
    """
    quaternion = np.array(rotation, float)
    length = float(np.linalg.norm(quaternion))
    if not all(map(math.isfinite, (*translation, length))):
        raise ValueError("a pose is not finite")
    if max(map(abs, translation)) > FARTHEST:
        raise ValueError("a pose is too large")
    if length < 1e-6:
        raise ValueError("a quaternion has length 0")
    x, y, z, w = quaternion / length
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = translation
    return T


def planar(T: np.ndarray) -> np.ndarray:
    """`(3,)`: x, y and the heading of a pose `(4, 4)` seen from above."""
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
