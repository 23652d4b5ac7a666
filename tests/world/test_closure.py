"""When answers close a cycle, and when they do not."""

import numpy as np

from aprjax.plane import compose
from aprjax.world.closure import ClosureConfig, Located, recognize
from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion
from aprjax.world.parts import Arc, Place
from aprjax.world.recognition import Sightings
from aprjax.world.smoothing import Measurements

NONE = np.zeros(0, int)
SURE = np.diag([1e-4, 1e-4, 1e-5])


def recognized(torn: float, apart: float) -> Place | None:
    """The robot drives past nodes 1 and 2, 2 m apart, and its scans look like both.

    Seen from its own node 0, node 2 lies `torn` metres too far; what looks like it, `apart`.
    """
    world = WorldModel()
    for _ in range(3):
        world.add_node()
    world.add_arc(Arc(0, 1, np.array([5.0, 0, 0]), SURE, "driven"))
    world.add_arc(Arc(1, 2, np.array([2.0, 0, 0]), 9 * SURE, "driven"))
    world.add_arc(Arc(0, 2, np.array([7.0 + torn, 0, 0]), SURE, "driven"))
    poses = np.array([[float(scan), 0.0, 0.0] for scan in range(36)])
    nothing = Measurements(NONE, NONE, np.zeros((0, 3)), np.zeros((0, 3, 3)))
    moved = Motion(poses, np.zeros((36, 3, 3)), poses[:, 0], nothing)
    places = {0: Place(1, np.zeros(3)), 1: Place(2, np.zeros(3))}
    scans = np.repeat(np.arange(30, 35), 2)
    ahead = np.array(
        [[scan - 30.0 - (2.0 - apart) * (k % 2), 0, 0] for k, scan in enumerate(scans)]
    )
    seen = Sightings(scans, np.tile([0, 1], 5), ahead, np.full(10, 0.2))
    believed = Located(Place(0, np.array([9.5, 0, 0])), np.diag([1.0, 1.0, 0.01]))
    return recognize(34, believed, 29, seen, places, moved, world, ClosureConfig())


def test_neighbouring_places_that_mean_one_pose_are_no_rivals_where_the_map_is_torn():
    for torn in (0.0, 1.6):
        place = recognized(torn, apart=0.0)
        assert place is not None
        T_first_node = np.array([2.0, 0, 0]) if place.node == 2 else np.zeros(3)
        np.testing.assert_allclose(compose(T_first_node, place.T_node_laser), [4, 0, 0], atol=1e-9)


def test_answers_that_mean_two_poses_close_nothing():
    assert recognized(0.0, apart=1.6) is None
