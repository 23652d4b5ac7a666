"""What a world model is made of: arcs, places, and what was seen at them."""

import operator
from dataclasses import dataclass

import numpy as np

from aprjax.plane import inverse, inverse_covariance

KINDS = ("driven", "closed")
"""How an arc was found: the robot drove along it, or recognized one end when it came there."""


MOST_ID = 2**31 - 1
"""Of nodes and references: arrays hold ids as int32."""
FARTHEST = 1e7
"""Of a pose's metres and radians, and squared of its covariance: more is a mistake, or meant to do
harm."""


class WorldModelError(ValueError):
    """An edit that would leave a world model inconsistent. One line: which part, and why."""


@dataclass(frozen=True, eq=False)
class Arc:
    """A way between two nodes."""

    a: int
    b: int
    T_a_b: np.ndarray
    """`(3,)`: b's frame in a's; metres, radians."""
    covariance: np.ndarray
    """`(3, 3)` of `T_a_b`."""
    kind: str
    """One of `KINDS`."""

    @property
    def length(self) -> float:
        """Metres between the nodes' origins."""
        return float(np.hypot(self.T_a_b[0], self.T_a_b[1]))

    def seen_from(self, node: int) -> "Arc":
        """The same arc with `node`, one of its ends, as `a`."""
        if node == self.a:
            return self
        covariance = inverse_covariance(self.T_a_b, self.covariance)
        return Arc(self.b, self.a, inverse(self.T_a_b), covariance, self.kind)


@dataclass(frozen=True, eq=False)
class Place:
    """Where in the super space something is: a pose in a node's frame."""

    node: int
    T_node_laser: np.ndarray
    """`(3,)` metres, radians."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """What one sensor saw of a node: a reference scan, or the class of an image."""

    place: Place
    scan: int | None = None
    """Number of the scan in the log that the map was built from."""
    image_class: int | None = None
    """None for a reference scan."""


@dataclass(frozen=True)
class ArcEnd:
    """The end of an arc that an appearance belongs to, and the direction of travel there."""

    node: int
    neighbour: int | None
    """The arc's other end; None where the node has no arc."""
    leaving: bool
    """Whether the sensor looked along the arc, away from the node, or back over it."""


def check_id(name: str, number: int) -> int:
    """A part's number as a plain int. Raise `WorldModelError` with its name if it can be none."""
    try:
        number = operator.index(number)
    except TypeError:
        raise WorldModelError(f"{name}: ids are whole numbers") from None
    if number < 0:
        raise WorldModelError(f"{name}: ids are not negative")
    if number > MOST_ID:
        raise WorldModelError(f"{name}: ids are at most {MOST_ID}")
    return number


def check_arc(arc: Arc) -> None:
    """Raise `WorldModelError` unless the arc's numbers can be those of an arc."""
    name = f"arc {arc.a}-{arc.b}"
    if arc.a == arc.b:
        raise WorldModelError(f"{name}: it starts where it ends")
    if arc.kind not in KINDS:
        raise WorldModelError(f"{name}: {arc.kind!r} is none of {', '.join(KINDS)}")
    check_pose(name, arc.T_a_b)
    covariance = np.asarray(arc.covariance)
    if covariance.shape != (3, 3) or not np.all(np.isfinite(covariance)):
        raise WorldModelError(f"{name}: its covariance is not (3, 3) and finite")
    if np.any(np.abs(covariance) > FARTHEST**2):
        raise WorldModelError(f"{name}: its covariance has entries over {FARTHEST**2:g}")
    if not np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12):
        raise WorldModelError(f"{name}: its covariance is not symmetric")
    if np.linalg.eigvalsh(covariance)[0] < -1e-9:
        raise WorldModelError(f"{name}: its covariance has a negative eigenvalue")


def check_pose(name: str, T: np.ndarray) -> None:
    """Raise `WorldModelError` with a part's name unless `T` can be a pose of it."""
    T = np.asarray(T)
    if T.shape != (3,) or not np.all(np.isfinite(T)):
        raise WorldModelError(f"{name}: {T} is no pose of three finite numbers")
    if np.any(np.abs(T) > FARTHEST):
        raise WorldModelError(f"{name}: {T} has numbers over {FARTHEST:g}")


def check_scan(name: str, scan: int | None) -> None:
    """Raise `WorldModelError` with a part's name unless a log may number a scan so, or is none."""
    try:
        possible = scan is None or operator.index(scan) >= 0
    except TypeError:
        possible = False
    if not possible:
        raise WorldModelError(f"{name}: there is no scan {scan}")
