"""What is built into a floor: doors, window niches, pillars, and the ways kept free for a robot."""

import numpy as np

from aprjax.plane import transform
from aprjax.sim.layout import Layout, Room
from aprjax.sim.rectangle import overlap
from aprjax.sim.walls import Door, Feature

CLEARANCE = 0.36
"""Metres from the robot's centre, inside its areas, to anything that does not walk."""
_LEAF = (0.86, 0.98)  # width of doors, metres
_SLACK = 0.06  # metres to either side of the middle of a door


def doorway(
    rng: np.random.Generator, room: Room, passable: bool
) -> tuple[Door, tuple[float, float]]:
    """The door of a room, which opens into it, and where along its wall the opening is."""
    width = rng.uniform(*_LEAF)
    most = room.width - width - 0.2
    start = rng.choice([rng.uniform(0.2, most), rng.uniform(0.2, 0.5), most - rng.uniform(0, 0.3)])
    left = rng.random() < 0.5
    hinge, beside = (start, start) if left else (start + width, room.width - start - width)
    door = Door(
        hinge=transform(room.T_world_room, np.array([hinge, 0.0])),
        shut=float(room.T_world_room[2] + (0.0 if left else np.pi)),
        width=width,
        swing=1 if left else -1,
        # An open leaf stops short of the wall beside it.
        widest=float(np.arccos(np.clip((0.05 - beside) / width, -0.98, 0.0))),
        passable=passable,
    )
    return door.moved(rng), (start, start + width)


def robot_areas(
    rng: np.random.Generator, room: Room, opening: tuple[float, float], across: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rectangles of the room's frame: the passage through its door, and the area behind.

    The passage reaches `across` metres out into the corridor.
    """
    middle, leaf = (opening[0] + opening[1]) / 2, opening[1] - opening[0]
    near = leaf + CLEARANCE
    far = max(near + 0.8, room.depth - CLEARANCE - rng.uniform(0.1, 1.0))
    reach = rng.uniform(0.15, np.clip(0.3 * (room.width - 1.5), 0.3, 1.0), 2)
    left = max(middle - reach[0], CLEARANCE + 0.02)
    right = min(middle + reach[1], room.width - CLEARANCE - 0.02)
    passage = np.array([(middle - _SLACK, -across), (middle + _SLACK, near + 0.3)])
    return passage, np.array([(left, near), (right, far)])


def room_features(
    rng: np.random.Generator, room: Room, opening: tuple[float, float], taken: list[np.ndarray]
) -> tuple[list[list[Feature]], list[np.ndarray]]:
    """Door, window niches and pillars on each wall of a room, and the floor that pillars take.

    No pillar stands on the rectangles `taken` of the room's frame.
    """
    features: list[list[Feature]] = [[Feature(*opening, None)], [], [], []]
    pillars: list[np.ndarray] = []

    def niche(wall: int, start: float, width: float, depth: float) -> None:
        if _free(features[wall], start, start + width, room.length(wall)):
            features[wall].append(Feature(start, start + width, depth))

    def pillar(wall: int, start: float, width: float, depth: float) -> None:
        corner = room.corners[wall]
        along = (room.corners[(wall + 1) % 4] - corner) / room.length(wall)
        inward = np.array([-along[1], along[0]])
        ends = corner + np.array([start * along, (start + width) * along + depth * inward])
        area = np.stack([ends.min(axis=0), ends.max(axis=0)])
        if all(overlap(area, other) is None for other in [*taken, *pillars]):
            before = len(features[wall])
            niche(wall, start, width, -depth)
            pillars.extend([area] * (len(features[wall]) - before))

    if rng.random() < 0.3:  # a shaft or chimney in a corner at the back
        width, depth = rng.uniform(0.3, 0.9, 2)
        pillar(2, rng.choice([0.0, room.width - width]), width, depth)
    if rng.random() < 0.7:  # radiators below the windows, or the niches for them
        length = room.length(room.outer)
        windows = max(1, int(length / rng.uniform(1.8, 2.8)))
        width, depth = rng.uniform(0.9, 1.5), rng.uniform(0.08, 0.3)
        for i in range(windows):
            niche(room.outer, (i + 0.5) * length / windows - width / 2, width, depth)
    for _ in range(rng.poisson(1.0)):
        width, wall = rng.uniform(0.2, 0.5), int(rng.integers(1, 4))
        rest = room.length(wall) - width
        start = rng.choice([0.0, rest, rng.uniform(0, rest)])
        pillar(wall, start, width, rng.uniform(0.12, 0.35))
    return features, pillars


def corridor_features(
    rng: np.random.Generator, layout: Layout, openings: list[np.ndarray], depth: float
) -> tuple[list[list[Feature]], list[np.ndarray]]:
    """Doors and pillars on each wall of the corridor, and the floor that pillars take.

    `openings` are the ends `(2, 2)` of the rooms' doors on the corridor's side; pillars stand out
    less than `depth` metres.
    """
    features: list[list[Feature]] = []
    pillars: list[np.ndarray] = []
    corners = layout.corridor_corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        inward = np.array([-along[1], along[0]])
        here = []
        for opening in openings:
            at, off = (opening - start) @ along, (opening - start) @ inward
            if np.all(np.abs(off) < 1e-6) and np.all((at > 0) & (at < length)):
                here.append(Feature(float(at.min()), float(at.max()), None))
        for _ in range(rng.poisson(0.15 * length)):
            width, out = rng.uniform(0.2, 0.6), rng.uniform(0.06, depth)
            at = rng.uniform(0, max(length - width, 0.0))
            if _free(here, at, at + width, length):
                here.append(Feature(at, at + width, -out))
                ends = start + np.array([at * along, (at + width) * along + out * inward])
                pillars.append(np.stack([ends.min(axis=0), ends.max(axis=0)]))
        features.append(here)
    return features, pillars


def _free(features: list[Feature], start: float, end: float, length: float) -> bool:
    """Whether a wall has room for another feature."""
    apart = all(end < f.start - 0.1 or start > f.end + 0.1 for f in features)
    return start >= 0 and end <= length and apart
