"""A run: what a robot records on a drive, and the truth."""

from dataclasses import dataclass, replace

import jax
import numpy as np

from aprjax.scan import Scan
from aprjax.sim.floor_plan import FloorPlan
from aprjax.sim.laser import Laser, take_scans
from aprjax.sim.odometry import OdometryConfig, odometry
from aprjax.sim.people import walking_people
from aprjax.sim.world import World


@dataclass(frozen=True)
class Run:
    """N scans of one drive, on the host. The laser sits at the robot's centre."""

    scans: Scan
    """Stacked."""
    T_world_laser: np.ndarray
    """`(N, 3)`, the truth in metres and radians."""
    odometry: np.ndarray
    """`(N, 3)` by the wheels, in a frame of its own that starts at (0, 0, 0)."""
    gyro: np.ndarray
    """`(N,)` headings in radians, from 0 on."""
    stamps: np.ndarray
    """`(N,)` seconds."""
    world: World
    """The surroundings without people."""

    def take(self, indices: np.ndarray) -> "Run":
        """Some of the scans with all that belongs to them."""
        return replace(
            self,
            scans=jax.tree.map(lambda array: array[indices], self.scans),
            T_world_laser=self.T_world_laser[indices],
            odometry=self.odometry[indices],
            gyro=self.gyro[indices],
            stamps=self.stamps[indices],
        )


def simulate(
    seed: int,
    plan: FloorPlan,
    T_world_laser: np.ndarray,
    stamps: np.ndarray,
    laser: Laser | None = None,
    people: int = 4,
    errors: OdometryConfig | None = None,
) -> Run:
    """What a robot records at poses `(N, 3)` and stamps `(N,)`, such as `drive` makes.

    `people` walk about meanwhile; `laser` defaults to a SICK at 1°. The same seed gives the same
    bits on the same device. Raises `ValueError` if the shapes do not fit.
    """
    laser = Laser.sick() if laser is None else laser
    poses, stamps = np.asarray(T_world_laser, float), np.asarray(stamps, float)
    wheels, gyro = odometry(seed, poses, stamps, errors)
    legs = walking_people(seed, plan, poses, stamps, people)
    world = plan.world()
    scans = take_scans(jax.random.key(seed), laser, world, legs, poses)
    return Run(scans, poses, wheels, gyro, stamps, world)
