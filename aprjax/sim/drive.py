"""Drives through a floor: a robot visits rooms and the ends of corridors at walking speed."""

import equinox as eqx
import networkx as nx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.plane import wrap
from aprjax.sim.floor_plan import FloorPlan
from aprjax.sim.routes import Waypoint, point_in, route

_STEP, _TURN = 0.02, np.radians(2.0)  # metres and radians between points of a way
_SHARP = 0.05  # metres that the robot may cut a corner between two areas
_CREEP = 0.05  # metres per second at least between two turns on the spot


class DriveConfig(eqx.Module):
    """How fast the robot goes."""

    slowest: Float[Array, ""] = threshold(0.4, "m/s: least cruising speed")
    fastest: Float[Array, ""] = threshold(1.0, "m/s: greatest cruising speed")
    acceleration: Float[Array, ""] = threshold(0.6, "m/s²: greatest, along the way")
    turn_rate: Float[Array, ""] = threshold(np.radians(45), "radians/s: greatest")

    def __check_init__(self) -> None:
        for name in ("slowest", "fastest", "acceleration", "turn_rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: {getattr(self, name)} is not positive and finite")
        if self.slowest > self.fastest:
            raise ValueError(f"slowest: {self.slowest} m/s is above fastest {self.fastest} m/s")


def drive(
    seed: int, plan: FloorPlan, scans: int, period: float, config: DriveConfig | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Poses `T_world_laser` `(scans, 3)` in metres and radians, and stamps `(scans,)` in seconds.

    One pose every `period` seconds from the start on, for as long as that takes. The robot goes to
    all rooms it may enter and all ends of corridors in a random order, then again in another; it
    cruises at another speed each time, and is slower where it turns, down to a turn on the spot.
    The laser sits at its centre. Raises `ValueError` for less than one scan, a period that is not
    positive, and a plan without areas.
    """
    config = DriveConfig() if config is None else config
    if scans < 1:
        raise ValueError(f"scans: {scans} is not a positive number")
    if not 0 < period < np.inf:
        raise ValueError(f"period: {period} s is not positive and finite")
    if not plan.areas:
        raise ValueError("plan: there is no area that the robot may be in")
    rng = np.random.default_rng(seed)
    stamps = period * np.arange(scans)
    node = int(rng.choice(list(plan.areas.nodes)))
    at = node, point_in(rng, plan.areas.nodes[node]["rectangle"])
    way, cruise = [Waypoint(at[1], 0.0)], [0.0]
    while True:
        for goal in _goals(rng, plan.areas):
            legs = route(rng, plan.areas, at, goal, _SHARP)
            way += legs
            cruise += [rng.uniform(config.slowest, config.fastest)] * len(legs)
            at = goal
        times, poses = _follow(way, np.array(cruise), config)
        if times[-1] >= stamps[-1]:
            break
    x, y, theta = (np.interp(stamps, times, column) for column in poses.T)
    return np.stack([x, y, wrap(theta)], axis=-1), stamps


def _goals(rng: np.random.Generator, areas: nx.Graph) -> list[tuple[int, np.ndarray]]:
    """One to three points in every room and one at each end of every corridor, shuffled."""
    visits = []
    for node, area in areas.nodes(data=True):
        low, high = area["rectangle"]
        if area["kind"] == "room":
            count = int(rng.integers(1, 4))
            visits.append([(node, rng.uniform(low, high)) for _ in range(count)])
        elif area["kind"] == "corridor":
            along = int(np.argmax(high - low))
            for end, inward in ((low, 1), (high, -1)):
                point = rng.uniform(low, high)
                point[along] = end[along] + inward * rng.uniform(0, 1.0)
                visits.append([(node, point)])
    return [goal for i in rng.permutation(len(visits)) for goal in visits[i]]


def _follow(
    way: list[Waypoint], cruise: np.ndarray, config: DriveConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Times `(P,)` and poses `(P, 3)` of a robot that drives along a way with rounded corners.

    `cruise` is the speed on the leg to each waypoint, in m/s. Headings are not wrapped.
    """
    kept = [0]
    kept += [i for i in range(1, len(way)) if np.hypot(*(way[i].xy - way[i - 1].xy)) > 0.05]
    xy = np.array([way[i].xy for i in kept])
    legs = np.diff(xy, axis=0)
    lengths, headings = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])

    # Straight pieces and arcs in turn: length, turn and speed of each.
    turns = wrap(np.diff(headings))
    half = np.abs(turns) / 2
    cuts = np.array([way[i].cut for i in kept[1:-1]])
    shortest = np.minimum(lengths[:-1], lengths[1:])
    with np.errstate(divide="ignore"):
        tangents = np.minimum(cuts / np.tan(half / 2), 0.45 * shortest)
    radii = np.where(half > 1e-6, tangents / np.maximum(np.tan(half), 1e-9), 0.0)
    straight = lengths - np.concatenate([[0], tangents]) - np.concatenate([tangents, [0]])
    pieces = np.zeros((len(straight) + len(turns), 3))
    speeds = cruise[kept[1:]]
    pieces[0::2] = np.stack([straight, np.zeros_like(straight), speeds], axis=-1)
    pieces[1::2] = np.stack([radii * np.abs(turns), turns, speeds[1:]], axis=-1)

    counts = np.ceil(np.maximum(pieces[:, 0] / _STEP, np.abs(pieces[:, 1]) / _TURN)).astype(int)
    counts = np.maximum(counts, 1)
    length, turn = (np.repeat(pieces[:, k] / counts, counts) for k in (0, 1))
    theta = headings[0] + np.concatenate([[0], np.cumsum(turn)])
    chord = length * np.sinc(turn / (2 * np.pi))
    middle = theta[:-1] + turn / 2
    steps = chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
    places = xy[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    times = _times(length, turn, np.repeat(pieces[:, 2], counts), config)
    return times, np.concatenate([places, theta[:, None]], axis=1)


def _times(
    length: np.ndarray, turn: np.ndarray, cruise: np.ndarray, config: DriveConfig
) -> np.ndarray:
    """When each point of a way is reached, in seconds: as fast as the limits allow."""
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = np.fmin(cruise, float(config.turn_rate) * length / np.abs(turn))
    speed = np.concatenate([[0], np.minimum(limit[:-1], limit[1:]), [0]])
    gain = (2 * float(config.acceleration) * length).tolist()
    square = (speed**2).tolist()
    for i, more in enumerate(gain):
        square[i + 1] = min(square[i + 1], square[i] + more)
    for i in range(len(gain) - 1, -1, -1):
        square[i] = min(square[i], square[i + 1] + gain[i])
    speed = np.sqrt(square)
    mean = np.maximum((speed[:-1] + speed[1:]) / 2, _CREEP)
    spent = np.maximum(length / mean, np.abs(turn) / float(config.turn_rate))
    return np.concatenate([[0], np.cumsum(spent)])
