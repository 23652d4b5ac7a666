"""The faces of walls: outlines of rooms with doors, niches and pillars, and door leaves."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

AJAR = np.radians((10.0, 70.0))
"""How far a door stands open that is neither shut nor passable, in radians."""
OPEN = np.radians(92.0)
"""From here on a robot that keeps to the middle passes the leaf."""


class Feature(NamedTuple):
    """Where an edge of an outline leaves its straight line, from `start` to `end` along it."""

    start: float
    end: float
    depth: float | None
    """Metres into the wall; negative for what stands out, such as a pillar; None for a door."""


def outline(corners: np.ndarray, features: list[list[Feature]]) -> np.ndarray:
    """Faces `(S, 2, 2)` of the walls around a polygon, in metres.

    `corners` `(K, 2)` are in counter-clockwise order, `features` are those of each of the K edges
    and must not overlap. Nothing is open but doors.
    """
    faces: list[tuple[np.ndarray, np.ndarray]] = []
    for start, end, here in zip(corners, np.roll(corners, -1, axis=0), features, strict=True):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        outward = np.array([along[1], -along[0]])
        runs: list[list[tuple[float, float]]] = [[(0.0, 0.0)]]
        for feature in sorted(here):
            runs[-1].append((feature.start, 0.0))
            if feature.depth is None:
                runs.append([])
            else:
                runs[-1] += [(feature.start, feature.depth), (feature.end, feature.depth)]
            runs[-1].append((feature.end, 0.0))
        runs[-1].append((length, 0.0))
        faces += [
            (start + a[0] * along + a[1] * outward, start + b[0] * along + b[1] * outward)
            for run in runs
            for a, b in pairwise(run)
            if a != b
        ]
    return np.array(faces)


@dataclass(frozen=True)
class Door:
    """A door leaf on its hinge, a line without thickness."""

    hinge: np.ndarray
    """`(2,)` in metres."""
    shut: float
    """Direction of the shut leaf from the hinge, in radians."""
    width: float
    """Of the leaf, in metres."""
    swing: int
    """1 if it opens counter-clockwise, -1 if clockwise."""
    widest: float
    """How far it opens until it meets a wall, in radians."""
    passable: bool
    """Whether a robot goes through: then it is never shut."""
    angle: float = 0.0
    """How far it stands open, in radians."""

    @property
    def leaf(self) -> np.ndarray:
        """Both ends `(2, 2)` in metres."""
        direction = self.shut + self.swing * self.angle
        tip = self.hinge + self.width * np.array([np.cos(direction), np.sin(direction)])
        return np.stack([self.hinge, tip])

    def moved(self, rng: np.random.Generator) -> "Door":
        """The same door as it may stand another time."""
        kind = (
            "open" if self.passable else rng.choice(["shut", "ajar", "open"], p=[0.6, 0.15, 0.25])
        )
        angle = {
            "shut": 0.0,
            "ajar": rng.uniform(*AJAR),
            "open": rng.uniform(OPEN, self.widest),
        }[str(kind)]
        return replace(self, angle=float(angle))
