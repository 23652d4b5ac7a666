"""How a floor is divided: a corridor, perhaps with an arm, and the rooms on both sides."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Room:
    """A rectangular room; its frame has x along the wall of the door and y into the room."""

    T_world_room: np.ndarray
    """`(3,)`, of the corner to the left as one looks in through the door."""
    width: float
    """Metres along x."""
    depth: float
    """Metres along y."""
    wall: float
    """Thickness of the wall with the door, in metres."""
    corridor: int
    """Which corridor the door leads to."""
    outer: int
    """Which wall has the windows; walls count counter-clockwise from the one with the door."""

    @property
    def corners(self) -> np.ndarray:
        """`(4, 2)` in the room's frame, counter-clockwise; wall k starts at corner k."""
        return np.array([(0, 0), (self.width, 0), (self.width, self.depth), (0, self.depth)], float)

    def length(self, wall: int) -> float:
        """Metres of one of the four walls."""
        return self.depth if wall % 2 else self.width


@dataclass(frozen=True)
class Layout:
    """The rectangles of a floor, in metres."""

    corridors: tuple[np.ndarray, ...]
    """Rectangles `(2, 2)`: the main one along x, and its arm along y if there is one."""
    rooms: tuple[Room, ...]

    @property
    def corridor_corners(self) -> np.ndarray:
        """`(K, 2)` of the corridor with its arm, counter-clockwise."""
        (left, low), (right, high) = self.corridors[0]
        corners = [(left, low), (right, low), (right, high)]
        if len(self.corridors) > 1:
            (arm_left, _), (arm_right, top) = self.corridors[1]
            mouth = [(arm_right, high), (arm_right, top), (arm_left, top), (arm_left, high)]
            # An arm at the end continues the end wall.
            corners = [*corners[:2], *mouth[1:]] if arm_right == right else [*corners, *mouth]
        return np.array([*corners, (left, high)])


def layout(rng: np.random.Generator) -> Layout:
    """A floor of 19 to 24 m by 10.5 to 14 m, its corridor along y = 0."""
    length, half = rng.uniform(19, 24), rng.uniform(1.1, 1.4)
    below, above = rng.uniform(4.4, 6.2), rng.uniform(4.8, 6.6)
    wall, partition = rng.uniform(0.12, 0.25), rng.uniform(0.08, 0.16)
    front, top = half + wall, half + wall + above
    corridors = [np.array([(0.0, -half), (length, half)])]
    rooms = [
        Room(np.array([right, -front, np.pi]), right - left, depth, wall, 0, 2)
        for left, right, depth in _row(rng, 0.0, length, below, partition)
    ]
    shape = rng.choice(["straight", "arm in the middle", "arm at the end"], p=[0.3, 0.35, 0.35])
    if shape == "straight":
        spans = [(0.0, length)]
    else:
        wide = rng.uniform(2.1, 2.6)
        left = length - wide if shape == "arm at the end" else rng.uniform(0.3, 0.6) * length
        corridors.append(np.array([(left, half), (left + wide, top)]))
        spans = [(0.0, left - wall), (left + wide + wall, length)]
    for side, (low, high) in enumerate(spans):
        if high <= low:
            continue
        row = _row(rng, low, high, above, partition)
        beside_arm = len(corridors) > 1 and rng.random() < 0.6
        for i, (left, right, depth) in enumerate(row):
            if beside_arm and side == 0 and i == len(row) - 1:
                frame = np.array([right, front, np.pi / 2])
                rooms.append(Room(frame, above, right - left, wall, 1, 1))
            elif beside_arm and side == 1 and i == 0:
                frame = np.array([left, top, -np.pi / 2])
                rooms.append(Room(frame, above, right - left, wall, 1, 3))
            else:
                frame = np.array([left, front, 0.0])
                rooms.append(Room(frame, right - left, depth, wall, 0, 2))
    return Layout(tuple(corridors), tuple(rooms))


def _row(
    rng: np.random.Generator, low: float, high: float, depth: float, partition: float
) -> list[tuple[float, float, float]]:
    """Rooms side by side: left and right wall and depth of each."""
    count = max(1, round((high - low) / rng.uniform(4.4, 5.6)))
    share = rng.uniform(0.75, 1.5, count)
    bounds = low + (high - low + partition) * np.concatenate([[0], np.cumsum(share) / share.sum()])
    return [
        (left, right - partition, depth - (rng.uniform(0.3, 0.9) if rng.random() < 0.3 else 0.0))
        for left, right in pairwise(bounds.tolist())
    ]
