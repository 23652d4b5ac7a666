"""Pieces of office furniture as a scanner 25 cm above the floor sees them.

Of a desk that is its legs or side panels and what stands under it, of a chair its legs or its
column. A shape's frame lies at the centre of its footprint, y towards its front.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from aprjax.plane import compose, transform
from aprjax.sim.rectangle import box, closed


class Shape(NamedTuple):
    """What is hit of a piece, in its own frame."""

    segments: np.ndarray
    """`(S, 2, 2)` in metres."""
    circles: np.ndarray
    """`(C, 3)`: x, y and radius in metres."""
    size: tuple[float, float]
    """Width and depth of the footprint in metres."""

    @property
    def reach(self) -> float:
        """Metres from the centre to the farthest corner of the footprint."""
        return float(np.hypot(*self.size)) / 2


class Territory(NamedTuple):
    """The place kept free for a piece that people move."""

    T_world_territory: np.ndarray
    """`(3,)`, of its centre and of the piece's usual direction."""
    half: tuple[float, float]
    """Metres that the piece's centre may lie from it along x and y."""
    turn: float
    """Radians that the piece may be turned to each side."""
    leaves: float
    """Probability that the piece is away."""

    def place(self, rng: np.random.Generator) -> tuple[np.ndarray, bool]:
        """A pose `(3,)` in the world, and whether the piece is there."""
        most = np.array([*self.half, self.turn])
        pose = compose(self.T_world_territory, rng.uniform(-most, most))
        return pose, bool(rng.random() >= self.leaves)


@dataclass(frozen=True)
class Piece:
    """A shape somewhere on the floor; `territory` is None where nobody moves it."""

    shape: Shape
    T_world_piece: np.ndarray
    territory: Territory | None = None
    present: bool = True

    @classmethod
    def movable(cls, rng: np.random.Generator, shape: Shape, territory: Territory) -> "Piece":
        """A piece somewhere in its territory."""
        pose, present = territory.place(rng)
        return cls(shape, pose, territory, present)

    def moved(self, rng: np.random.Generator) -> "Piece":
        """The piece as somebody may have left it another time."""
        if self.territory is None:
            return self
        pose, present = self.territory.place(rng)
        return replace(self, T_world_piece=pose, present=present)

    @property
    def surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        """Segments `(S, 2, 2)` and circles `(C, 3)` in the world; none if the piece is away."""
        if not self.present:
            return np.zeros((0, 2, 2)), np.zeros((0, 3))
        circles = self.shape.circles.copy()
        circles[:, :2] = transform(self.T_world_piece, circles[:, :2])
        return transform(self.T_world_piece, self.shape.segments), circles


def _shape(width: float, depth: float, boxes: list[np.ndarray], circles: list[tuple]) -> Shape:
    segments = np.concatenate(boxes) if boxes else np.zeros((0, 2, 2))
    return Shape(segments, np.array(circles, float).reshape(-1, 3), (width, depth))


def _at_corners(width: float, depth: float, radius: float) -> list[tuple]:
    x, y = width / 2 - radius, depth / 2 - radius
    return [(sx * x, sy * y, radius) for sx in (-1, 1) for sy in (-1, 1)]


def block(width: float, depth: float) -> Shape:
    """A cupboard, carton, copier or sofa: closed down to the floor."""
    return _shape(width, depth, [box(width, depth)], [])


def drum(radius: float) -> Shape:
    """A waste basket or flower pot."""
    return _shape(2 * radius, 2 * radius, [], [(0.0, 0.0, radius)])


def shelf(rng: np.random.Generator, width: float, depth: float) -> Shape:
    """Open bays full of files and boxes, none as deep as the next."""
    bays = max(1, round(width / 0.8))
    boards = np.linspace(-width / 2, width / 2, bays + 1)
    boxes = [box(0.02, depth, x=x * (1 - 0.02 / width)) for x in boards]
    for left, right in pairwise(boards):
        while left < right - 0.05:
            item = min(rng.uniform(0.05, 0.35), right - left)
            filled = rng.uniform(0.35, 0.95) * depth
            boxes.append(box(item, filled, x=left + item / 2, y=(filled - depth) / 2))
            left += item + (rng.uniform(0.02, 0.2) if rng.random() < 0.3 else 0.0)
    return _shape(width, depth, boxes, [])


def heap(rng: np.random.Generator, radius: float) -> Shape:
    """A bag, a coat or a pile of paper: no side of it is straight for long."""
    corners = int(rng.integers(6, 11))
    angles = 2 * np.pi * (np.arange(corners) + rng.uniform(0, 0.6, corners)) / corners
    radii = radius * rng.uniform(0.55, 1.0, corners)
    outline = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    return _shape(2 * radius, 2 * radius, [closed(outline)], [])


def desk(rng: np.random.Generator, width: float, depth: float) -> Shape:
    """Legs or side panels, and often a drawer unit, a computer or a panel at the back."""
    boxes, circles = [], []
    if rng.random() < 0.5:
        circles = _at_corners(width, depth, float(rng.uniform(0.02, 0.035)))
    else:
        panel = rng.uniform(0.6, 0.95) * depth
        boxes = [box(0.03, panel, x=side * (width / 2 - 0.015)) for side in (-1, 1)]
    side = rng.choice([-1, 1])
    if rng.random() < 0.6:
        boxes.append(box(0.42, 0.58, x=side * (width / 2 - 0.27), y=rng.uniform(-0.05, 0.05)))
    if rng.random() < 0.4:
        boxes.append(box(0.2, 0.45, x=-side * (width / 2 - 0.2), y=-depth / 2 + 0.3))
    if rng.random() < 0.5:
        place = rng.uniform((-width / 4, -depth / 4), (width / 4, depth / 4))
        boxes.append(heap(rng, rng.uniform(0.1, 0.25)).segments + place)
    if rng.random() < 0.3:
        boxes.append(box(width - 0.1, 0.02, y=-depth / 2 + rng.uniform(0.03, 0.25)))
    return _shape(width, depth, boxes, circles)


def table(rng: np.random.Generator, width: float, depth: float) -> Shape:
    """Four legs, round or square; a long one has six."""
    radius = float(rng.uniform(0.02, 0.04))
    legs = _at_corners(width, depth, radius)
    if width > 1.8:
        legs += [(0.0, side * (depth / 2 - radius), radius) for side in (-1, 1)]
    if rng.random() < 0.5:
        return _shape(width, depth, [], legs)
    return _shape(width, depth, [box(2 * r, 2 * r, x, y) for x, y, r in legs], [])


def bench(rng: np.random.Generator, width: float, depth: float) -> Shape:
    """A laboratory bench on panels, with cupboards under some of its bays."""
    bays = max(1, round(width / 0.9))
    step = width / bays
    boxes = [
        box(0.04, depth - 0.1, x=-width / 2 + 0.02 + i * (width - 0.04) / bays)
        for i in range(bays + 1)
    ]
    for i in range(bays):
        if rng.random() < 0.5:
            inner = depth - rng.uniform(0.05, 0.2)
            boxes.append(
                box(step - 0.04, inner, x=-width / 2 + (i + 0.5) * step, y=(inner - depth) / 2)
            )
    return _shape(width, depth, boxes, [])


def chair(rng: np.random.Generator) -> Shape:
    """Four legs, or the column of a swivel chair with the ends of its five arms."""
    if rng.random() < 0.5:
        side = float(rng.uniform(0.4, 0.46))
        return _shape(side, side, [], _at_corners(side, side, float(rng.uniform(0.011, 0.016))))
    arms = rng.uniform(0, 2 * np.pi) + 2 * np.pi / 5 * np.arange(5)
    castors = [(0.24 * np.cos(arm), 0.24 * np.sin(arm), 0.025) for arm in arms]
    return _shape(0.53, 0.53, [], [(0.0, 0.0, 0.035), *castors])


def trolley(rng: np.random.Generator) -> Shape:
    """A trolley with its lower board at the scanner's height, or on four legs."""
    width, depth = rng.uniform(0.7, 1.0), rng.uniform(0.45, 0.6)
    if rng.random() < 0.5:
        return block(float(width), float(depth))
    return _shape(width, depth, [], _at_corners(width, depth, 0.02))
