"""The paper's experiment (2.E) as data: references of one run, queries of another."""

from dataclasses import dataclass

import numpy as np

from aprjax.plane import wrap
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import FloorPlan, office
from aprjax.sim.laser import Laser
from aprjax.sim.run import Run, simulate

SCANS = 1405
"""Scans of the paper's test run; the reference run is as long."""
PERIOD = 0.2
"""Seconds between them."""
_VISITED = 3  # rooms; thirty references show no more of a floor from all sides
_REARRANGED = 0.25  # share of the movable things that stand elsewhere in the second run


@dataclass(frozen=True)
class Lab:
    """A floor, a run to learn it from and an independent run to recognize it in."""

    plan: FloorPlan
    """At the time of the reference run."""
    references: Run
    """Scans of the reference run that show each of its places from each of its sides."""
    reference_run: Run
    queries: Run
    """The second run: other ways, other people, some doors and furniture elsewhere."""


def lab(seed: int, references: int = 30, queries: int = SCANS, laser: Laser | None = None) -> Lab:
    """The lab of a seed. The same seed gives the same bits on the same device.

    Both runs last as long as the paper's 1405 scans at 5 Hz, for fewer `queries` are fewer scans
    of the same drive; the reference run does not depend on them. Raises `ValueError` unless
    there are 1 to 1405 references and at least one query.
    """
    laser = Laser.sick(0.5) if laser is None else laser
    if not 1 <= references <= SCANS:
        raise ValueError(f"references: {references} is not from 1 to {SCANS}")
    if queries < 1:
        raise ValueError(f"queries: {queries} is not a positive number")
    floor, first_way, first, moved, second_way, second = (
        int(child.generate_state(1)[0]) for child in np.random.SeedSequence(seed).spawn(6)
    )
    plan = office(floor, visited=_VISITED)
    reference_run = simulate(first, plan, *drive(first_way, plan, SCANS, PERIOD), laser)
    later = plan.rearranged(moved, _REARRANGED)
    way = drive(second_way, later, queries, PERIOD * SCANS / queries)
    return Lab(
        plan=plan,
        references=reference_run.take(choose_references(reference_run.T_world_laser, references)),
        reference_run=reference_run,
        queries=simulate(second, later, *way, laser),
    )


def choose_references(
    T_world_laser: np.ndarray, count: int, distance: float = 1.5, angle: float = np.radians(40)
) -> np.ndarray:
    """Numbers `(count,)`, ascending, of poses of a run that together show most of it.

    A reference serves a pose the less, the farther off it was taken and the more it looks
    elsewhere: by exp(-(d/`distance`)² - (φ/`angle`)²). One after the other, the pose is chosen
    that adds most to what the best references of all poses of the run do for them.
    """
    gap = T_world_laser[:, None] - T_world_laser
    square = (gap[..., 0] ** 2 + gap[..., 1] ** 2) / distance**2 + (wrap(gap[..., 2]) / angle) ** 2
    serves = np.exp(-square)
    served, chosen = np.zeros(len(serves)), []
    for _ in range(count):
        added = np.maximum(serves - served, 0.0).sum(axis=1)
        added[chosen] = -1.0
        chosen.append(int(np.argmax(added)))
        served = np.maximum(served, serves[chosen[-1]])
    return np.sort(chosen)
