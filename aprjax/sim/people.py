"""People who walk about a floor; a scanner near the ground sees their legs."""

import numpy as np

from aprjax.sim.floor_plan import FloorPlan
from aprjax.sim.routes import point_in, route

KEPT_OFF = 0.5
"""Metres that people leave at least between their legs and the robot's centre."""
SPEED = (0.8, 1.5)
"""Metres per second that people walk at."""
_STRIDE, _REACH, _APART = 1.4, 0.28, 0.09  # of a gait: period, swing and half the legs' distance
_LEG = (0.05, 0.075)  # radius of a leg, metres
_ELSEWHERE = 12.0  # seconds that somebody is away at the mean
_TRIES = 12


def walking_people(
    seed: int, plan: FloorPlan, T_world_robot: np.ndarray, stamps: np.ndarray, people: int
) -> np.ndarray:
    """Legs as circles `(N, 2 people, 3)`: x, y and radius in metres at each of N stamps.

    Each of the people goes from one of the floor's free areas to another, stands a while, is out
    of the building a while and goes another way. Whoever would come too near the robot, whose
    poses `(N, 3)` at the `stamps` `(N,)` in seconds are known, does not come: at each stamp, all
    legs keep `KEPT_OFF` metres off. Somebody who is away has legs of radius 0.
    """
    if people < 0:
        raise ValueError(f"people: {people} is negative")
    legs = np.zeros((len(stamps), 2 * people, 3))
    robot = np.asarray(T_world_robot, float)[:, None, :2]
    for person, rng in enumerate(np.random.default_rng(seed).spawn(people)):
        radius = rng.uniform(*_LEG)
        free = stamps[0] + rng.uniform(-_ELSEWHERE, _ELSEWHERE)
        while free < stamps[-1]:
            free += _ELSEWHERE / _TRIES * rng.exponential()
            times, way = _walk(rng, plan)
            here = np.flatnonzero((stamps >= free) & (stamps <= free + times[-1]))
            xy = _legs(times, way, stamps[here] - free)
            apart = np.linalg.norm(xy - robot[here], axis=-1) - radius
            if np.all(apart >= KEPT_OFF):
                legs[here, 2 * person : 2 * person + 2] = np.concatenate(
                    [xy, np.full((*xy.shape[:2], 1), radius)], axis=-1
                )
                free += times[-1] + rng.exponential(_ELSEWHERE)
    return legs


def _walk(rng: np.random.Generator, plan: FloorPlan) -> tuple[np.ndarray, np.ndarray]:
    """Times `(P,)` from 0 on and places `(P, 2)` of somebody who walks, then stands a while."""
    nodes = list(plan.areas.nodes)
    ends = [
        (node, point_in(rng, plan.areas.nodes[node]["rectangle"])) for node in rng.choice(nodes, 2)
    ]
    way = [ends[0][1], *(point.xy for point in route(rng, plan.areas, ends[0], ends[1], 0.0))]
    lengths = np.hypot(*np.diff(way, axis=0).T)
    times = np.concatenate([[0], np.cumsum(lengths / rng.uniform(*SPEED))])
    stands = rng.exponential(4.0) if rng.random() < 0.5 else 0.0
    return np.append(times, times[-1] + stands), np.stack([*way, way[-1]])


def _legs(times: np.ndarray, way: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Both legs' places `(T, 2, 2)` at times `at` `(T,)`, swinging as far as the person walks."""
    body = np.stack([np.interp(at, times, column) for column in way.T], axis=-1)
    leg = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    step = way[leg + 1] - way[leg]
    length = np.hypot(*step.T)
    # Somebody who stands faces where he went last.
    ahead = np.where(length[:, None] > 0, step, way[-2] - way[-3])
    ahead = ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    gone = np.interp(at, times, np.concatenate([[0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))]))
    swing = _REACH * np.sin(2 * np.pi * gone / _STRIDE) * (length > 0)
    offset = swing[:, None] * ahead + _APART * aside
    return np.stack([body + offset, body - offset], axis=1)
