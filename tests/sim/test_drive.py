import numpy as np
import pytest

from aprjax.sim.drive import DriveConfig, drive
from aprjax.sim.floor_plan import office
from aprjax.sim.people import KEPT_OFF, walking_people
from tests.sim.plans import clearance_of

SCANS, PERIOD = 1200, 0.1
ROBOT = 0.3  # metres, its radius


@pytest.fixture(scope="module", params=(0, 1, 2))
def driven(request):
    plan = office(request.param, visited=3)
    return plan, *drive(request.param + 10, plan, SCANS, PERIOD)


def turns(poses):
    return np.abs(np.mod(np.diff(poses[:, 2]) + np.pi, 2 * np.pi) - np.pi)


def test_a_drive_has_the_number_of_poses_and_stamps_asked_for(driven):
    _, poses, stamps = driven
    assert poses.shape == (SCANS, 3)
    np.testing.assert_allclose(stamps, PERIOD * np.arange(SCANS))
    assert np.all(np.abs(poses[:, 2]) <= np.pi)


def test_the_robot_touches_nothing_neither_now_nor_after_things_were_moved(driven):
    plan, poses, _ = driven
    between = 0.5 * (poses[1:, :2] + poses[:-1, :2])
    for world in (plan.world(), plan.rearranged(3, 1.0).world()):
        assert clearance_of(world, np.concatenate([poses[:, :2], between])).min() >= ROBOT


def test_the_robot_keeps_to_its_speed_and_turn_rate(driven):
    _, poses, _ = driven
    config = DriveConfig()
    speed = np.hypot(*np.diff(poses[:, :2], axis=0).T) / PERIOD
    assert speed.max() <= float(config.fastest) + 1e-3
    assert turns(poses).max() / PERIOD <= float(config.turn_rate) + 1e-3
    assert np.abs(np.diff(speed)).max() / PERIOD <= 3 * float(config.acceleration)
    assert speed.mean() > 0.2


def test_the_robot_visits_every_room_it_may_enter(driven):
    plan, _, _ = driven
    poses, _ = drive(4, plan, 4000, 0.2)
    for _, area in plan.areas.nodes(data=True):
        if area["kind"] == "room":
            low, high = area["rectangle"]
            assert np.any(np.all((poses[:, :2] >= low) & (poses[:, :2] <= high), axis=1))


def test_the_same_seed_gives_the_same_drive_and_another_seed_another(driven):
    plan, *_ = driven
    one, two = drive(5, plan, 300, PERIOD), drive(5, plan, 300, PERIOD)
    np.testing.assert_array_equal(one[0], two[0])
    assert not np.array_equal(one[0], drive(6, plan, 300, PERIOD)[0])


def test_impossible_drives_are_refused_by_name_and_value(driven):
    plan, *_ = driven
    for arguments, message in (
        ((plan, 0, 0.2), "scans: 0"),
        ((plan, 5, 0.0), r"period: 0\.0 s"),
    ):
        with pytest.raises(ValueError, match=message):
            drive(0, *arguments)
    with pytest.raises(ValueError, match=r"slowest: 2\.0 m/s is above fastest"):
        DriveConfig(slowest=2.0)
    with pytest.raises(ValueError, match="turn_rate"):
        DriveConfig(turn_rate=0.0)


def test_people_keep_their_distance_and_walk_no_faster_than_people_do(driven):
    plan, poses, stamps = driven
    legs = walking_people(1, plan, poses, stamps, 6)
    assert legs.shape == (SCANS, 12, 3)
    there = legs[..., 2] > 0
    assert there.any()
    apart = np.linalg.norm(legs[..., :2] - poses[:, None, :2], axis=-1) - legs[..., 2]
    assert np.all(apart[there] >= KEPT_OFF - 1e-6)
    body = 0.5 * (legs[:, 0::2, :2] + legs[:, 1::2, :2])
    both = there[1:, 0::2] & there[:-1, 0::2]
    speed = np.linalg.norm(np.diff(body, axis=0), axis=-1)[both] / PERIOD
    assert np.percentile(speed, 99) <= 1.6
    np.testing.assert_array_equal(legs, walking_people(1, plan, poses, stamps, 6))
    assert not walking_people(1, plan, poses, stamps, 0).size
    with pytest.raises(ValueError, match="people: -1"):
        walking_people(1, plan, poses, stamps, -1)
