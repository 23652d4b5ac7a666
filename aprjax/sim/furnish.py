"""Furnishing of rooms and corridors, each kind in its own way."""

from collections.abc import Callable, Sequence

import numpy as np

from aprjax.plane import compose
from aprjax.sim.furniture import (
    Piece,
    Shape,
    Territory,
    bench,
    block,
    chair,
    desk,
    drum,
    heap,
    shelf,
    table,
    trolley,
)
from aprjax.sim.rectangle import overlap

FRONT, RIGHT, BACK, LEFT = range(4)
"""The walls of a room as seen from above, the door in the front wall."""
_TRIES = 15
_QUARTER = np.pi / 2


class Space:
    """The floor of one room while it is being furnished: what is taken, and what stands where.

    The room's frame has x along the front wall and y into the room, its origin in a corner. What
    finds no place after a few tries is left out.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        T_world_room: np.ndarray,
        size: tuple[float, float],
        taken: Sequence[np.ndarray],
    ):
        self.rng = rng
        self.T_world_room = T_world_room
        self.size = size
        self.pieces: list[Piece] = []
        self._taken = list(taken)

    def at_wall(
        self, width: float, depth: float, walls: Sequence[int] = (RIGHT, BACK, LEFT)
    ) -> np.ndarray | None:
        """The pose of a footprint with its back to a wall, which it then takes."""
        for _ in range(_TRIES):
            wall = int(self.rng.choice(walls))
            length = self.size[wall % 2]
            if length < width:
                continue
            # Furniture stands in corners and side by side, or anywhere.
            along = (
                self.rng.uniform(width / 2, length - width / 2)
                if self.rng.random() < 0.6
                else self.rng.choice([width / 2, length - width / 2])
            )
            off = depth / 2 + self.rng.uniform(0.0, 0.04)
            x, y = {
                FRONT: (along, off),
                RIGHT: (self.size[0] - off, along),
                BACK: (along, self.size[1] - off),
                LEFT: (off, along),
            }[wall]
            pose = np.array([x, y, wall * _QUARTER])
            if self._take(pose, width, depth):
                return pose
        return None

    def inside(self, width: float, depth: float) -> np.ndarray | None:
        """The pose of a footprint anywhere in the room, which it then takes."""
        for _ in range(_TRIES):
            pose = np.array([*self.rng.uniform((0, 0), self.size), self.rng.integers(4) * _QUARTER])
            if self._take(pose, width, depth):
                return pose
        return None

    def put(self, shape: Shape, T_room_piece: np.ndarray | None) -> None:
        """A piece that stays where it is."""
        if T_room_piece is not None:
            self.pieces.append(Piece(shape, compose(self.T_world_room, T_room_piece)))

    def put_loose(
        self,
        shape: Shape,
        T_room_territory: np.ndarray | None,
        half: tuple[float, float],
        turn: float,
        leaves: float = 0.1,
    ) -> None:
        """A piece that people move about within `half` metres of a place."""
        if T_room_territory is not None:
            place = compose(self.T_world_room, T_room_territory)
            self.pieces.append(Piece.movable(self.rng, shape, Territory(place, half, turn, leaves)))

    def _take(self, pose: np.ndarray, width: float, depth: float) -> bool:
        half = np.array([width, depth]) / 2
        if round(pose[2] / _QUARTER) % 2:
            half = half[::-1]
        area = np.stack([pose[:2] - half, pose[:2] + half])
        if np.any(area[0] < 0) or np.any(area[1] > self.size):
            return False
        if any(overlap(area, other) is not None for other in self._taken):
            return False
        self._taken.append(area)
        return True


def workplace(space: Space) -> None:
    """A desk at a wall or out in the room, with its chair before it."""
    rng = space.rng
    width, depth, before = rng.uniform(1.2, 1.8), rng.uniform(0.7, 0.85), 0.75
    find = space.at_wall if rng.random() < 0.75 else space.inside
    place = find(width, depth + before)
    if place is None:
        return
    space.put(desk(rng, width, depth), compose(place, np.array([0.0, -before / 2, 0.0])))
    seat = compose(place, np.array([0.0, (depth + before) / 2 - 0.6, 0.0]))
    space.put_loose(chair(rng), seat, (width / 2 - 0.35, 0.3), np.pi, leaves=0.05)


def conference(space: Space) -> None:
    """A table with chairs along both sides."""
    rng = space.rng
    for width, depth in ((rng.uniform(1.8, 3.0), 1.0), (rng.uniform(1.0, 1.4), 0.8)):
        place = space.inside(width + 0.2, depth + 1.3)
        if place is None:
            continue
        space.put(table(rng, width, depth), place)
        seats = int(width / 0.7)
        for i in range(seats):
            x = (i - (seats - 1) / 2) * width / seats
            for side in (-1, 1):
                seat = compose(place, np.array([x, side * (depth / 2 + 0.2), 0.0]))
                space.put_loose(chair(rng), seat, (0.05, 0.15), 0.4, leaves=0.15)
        return


def storage(space: Space, walls: Sequence[int] = (FRONT, RIGHT, BACK, LEFT)) -> None:
    """A cupboard or a shelf."""
    rng = space.rng
    width = rng.choice([0.8, 1.0, 1.2, 1.6, 2.0]) + rng.uniform(-0.05, 0.05)
    if rng.random() < 0.6:
        depth = rng.uniform(0.38, 0.6)
        space.put(block(width, depth), space.at_wall(width, depth, walls))
    else:
        depth = rng.uniform(0.28, 0.4)
        space.put(shelf(rng, width, depth), space.at_wall(width, depth, walls))


def laboratory_bench(space: Space) -> None:
    """A bench along a wall with a stool before it."""
    rng = space.rng
    width, depth, before = rng.uniform(1.5, 3.2), rng.uniform(0.65, 0.8), 0.6
    place = space.at_wall(width, depth + before)
    if place is None:
        return
    space.put(bench(rng, width, depth), compose(place, np.array([0.0, -before / 2, 0.0])))
    seat = compose(place, np.array([0.0, (depth + before) / 2 - 0.32, 0.0]))
    space.put_loose(chair(rng), seat, (width / 2 - 0.35, 0.0), np.pi)


def small(space: Space) -> None:
    """A waste basket, a carton or a flower pot, by a wall or in the way."""
    rng = space.rng
    shape = [
        drum(rng.uniform(0.11, 0.17)),
        drum(rng.uniform(0.18, 0.35)),
        block(rng.uniform(0.25, 0.6), rng.uniform(0.2, 0.45)),
        heap(rng, rng.uniform(0.15, 0.45)),
    ][int(rng.choice(4, p=[0.3, 0.2, 0.2, 0.3]))]
    room = 2 * shape.reach + rng.uniform(0.05, 0.6)
    find = space.at_wall if rng.random() < 0.7 else space.inside
    half = room / 2 - shape.reach
    space.put_loose(shape, find(room, room), (half, half), np.pi, leaves=0.2)


def seating(space: Space) -> None:
    """A sofa or an armchair."""
    width, depth = space.rng.choice([0.8, 1.6, 1.9]), space.rng.uniform(0.75, 0.9)
    space.put(block(width, depth), space.at_wall(width, depth))


def spare_chair(space: Space) -> None:
    """A chair on its own."""
    space.put_loose(chair(space.rng), space.inside(0.9, 0.9), (0.12, 0.12), np.pi)


def wheeled(space: Space) -> None:
    """A trolley that is pushed about."""
    shape = trolley(space.rng)
    room = 2 * shape.reach + space.rng.uniform(0.1, 0.6)
    half = room / 2 - shape.reach
    space.put_loose(shape, space.inside(room, room), (half, half), np.pi, leaves=0.3)


Item = Callable[[Space], None]

PROGRAMMES: dict[str, list[tuple[Item, float]]] = {
    "office": [
        (storage, 0.2), (workplace, 0.22), (small, 0.3), (spare_chair, 0.15), (seating, 0.03),
    ],
    "meeting room": [(conference, 0.12), (storage, 0.12), (small, 0.15), (spare_chair, 0.15)],
    "laboratory": [
        (laboratory_bench, 0.15), (storage, 0.15), (workplace, 0.1), (wheeled, 0.1),
        (spare_chair, 0.2), (small, 0.3),
    ],
    "store room": [(storage, 0.4), (wheeled, 0.1), (spare_chair, 0.2), (small, 0.5)],
    "lounge": [
        (seating, 0.1), (conference, 0.1), (storage, 0.1), (spare_chair, 0.2), (small, 0.2),
    ],
}  # fmt: skip
"""For each kind of room what is tried, and how often per square metre."""


def furnish(space: Space, kind: str, clutter: float) -> list[Piece]:
    """The pieces of a room; `clutter` scales how many there are."""
    area = space.size[0] * space.size[1]
    for item, density in PROGRAMMES[kind]:
        for _ in range(int(space.rng.poisson(density * area * clutter))):
            item(space)
    return space.pieces


def furnish_corridor(
    space: Space, walls: tuple[int, int], depth: float, clutter: float
) -> list[Piece]:
    """Cupboards, chairs and small things along both walls, none deeper than `depth` metres."""
    rng = space.rng
    length = max(space.size)
    for _ in range(int(rng.poisson(0.25 * length * clutter))):
        width, thick = rng.choice([0.4, 0.8, 1.0, 1.6]), rng.uniform(0.3, depth)
        space.put(block(width, thick), space.at_wall(width, thick, walls))
    for _ in range(int(rng.poisson(0.35 * length * clutter))):
        shape = [
            drum(rng.uniform(0.1, depth / 2)),
            heap(rng, rng.uniform(0.1, depth / 2)),
            block(rng.uniform(0.2, 0.28), rng.uniform(0.15, 0.25)),
        ][int(rng.integers(3))]
        place = space.at_wall(2 * shape.reach + 0.5, depth, walls)
        half = (0.25, max(0.0, depth / 2 - shape.reach))
        space.put_loose(shape, place, half, np.pi, leaves=0.2)
    return space.pieces
