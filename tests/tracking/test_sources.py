import json
from types import SimpleNamespace

import numpy as np
import pytest

import aprjax.tracking.scan_motion as motion
from aprjax.plane import compose, compose_covariance
from aprjax.scan import Scan
from aprjax.tracking import validation
from aprjax.tracking.apr import AprSource, MatchedSource, estimates
from aprjax.tracking.continuity import ScanContinuity, end_points
from aprjax.tracking.hypothesis import Step, VolumeConfig
from aprjax.tracking.idc import Idc
from aprjax.tracking.neighbours import Neighbours, seen_from
from aprjax.tracking.odometry import Gyro, OdometryConfig, WheelOdometry
from aprjax.world import alignment
from aprjax.world.parts import Place
from tests.tracking.worlds import EXACT, at, corridor, drive, sure, tracker
from tests.worlds import office, scan_at


def test_the_first_odometry_gives_no_step_and_the_others_the_relative_motion():
    odometry = WheelOdometry()
    assert odometry.step([5.0, 1.0, np.pi / 2], None) is None
    step = odometry.step([5.0, 2.0, np.pi], None)
    np.testing.assert_allclose(step.T_before_now, [1, 0, np.pi / 2], atol=1e-12)


def test_a_robot_at_rest_has_no_error():
    odometry = WheelOdometry()
    odometry.step([1.0, 2.0, 3.0], None)
    np.testing.assert_array_equal(odometry.step([1.0, 2.0, 3.0], None).covariance, EXACT)


def test_a_laser_ahead_of_the_wheels_swings_when_the_robot_turns():
    odometry = WheelOdometry(T_robot_laser=(0.3, 0.0, 0.0))
    odometry.step([0.0, 0.0, 0.0], None)
    turned = odometry.step([0.0, 0.0, np.pi / 2], None)
    np.testing.assert_allclose(turned.T_before_now, [-0.3, 0.3, np.pi / 2], atol=1e-12)
    # What the heading may be off carries the laser aside.
    centred = WheelOdometry().covariance(np.array([0.0, 0.0, np.pi / 2]))
    assert turned.covariance[0, 0] > centred[0, 0]
    ahead = odometry.step([0.0, 1.0, np.pi / 2], None)
    np.testing.assert_allclose(ahead.T_before_now, [1.0, 0.0, 0.0], atol=1e-12)


def test_a_laser_that_looks_back_moves_backwards():
    odometry = WheelOdometry(T_robot_laser=(0.0, 0.0, np.pi))
    odometry.step([0.0, 0.0, 0.0], None)
    np.testing.assert_allclose(
        odometry.step([1.0, 0.0, 0.0], None).T_before_now, [-1, 0, 0], atol=1e-9
    )
    with pytest.raises(ValueError, match="T_robot_laser"):
        WheelOdometry(T_robot_laser=(0.0, np.nan, 0.0))


def test_odometry_grows_with_the_way_and_does_not_depend_on_the_length_of_the_steps():
    model = WheelOdometry(OdometryConfig(slip=0.0, turn=0.0))
    one = model.covariance(np.array([2.0, 0, 0.0]))
    parts, T = np.zeros((3, 3)), np.zeros(3)
    step = np.array([0.02, 0, 0.0])
    for _ in range(100):
        parts = compose_covariance(T, parts, step, model.covariance(step))
        T = compose(T, step)
    np.testing.assert_allclose(parts, one, rtol=1e-3, atol=1e-9)
    assert np.all(np.diag(model.covariance(np.array([3.0, 0, 0.5]))) > np.diag(one))


def test_what_a_long_step_may_be_turned_carries_its_end_aside():
    covariance = WheelOdometry().covariance(np.array([0.0, 2.0, 0.3]))
    assert covariance[0, 0] > 5 * covariance[1, 1]
    assert (
        covariance[0, 2] < 0 < np.linalg.eigvalsh(covariance)[0]
    )  # turned more, it ends up behind


@pytest.mark.parametrize("reading", [[1.0, 2.0], [0.0, np.nan, 0.0], None, "pose"])
def test_odometry_that_is_no_pose_is_refused(reading):
    with pytest.raises((ValueError, TypeError)):
        WheelOdometry().step(reading, None)


def test_odometry_that_starts_anew_is_left_out_and_goes_on_from_there(caplog):
    made = tracker(tracking=[WheelOdometry()])
    made.observe(estimates=[at()])
    for x in (0.0, 50.0, 51.0):
        made.move(odometry=[x, 0.0, 0.0])
    assert made.belief.best.place.T_node_laser[0] == pytest.approx(1.0)
    assert "new start" in caplog.text


def test_a_gyro_measures_turns_across_the_half_turn_and_no_way():
    gyro = Gyro()
    assert gyro.step(3.1, None) is None
    step = gyro.step(-3.1, None)
    assert step.T_before_now[2] == pytest.approx(2 * np.pi - 6.2)
    assert np.isinf(step.covariance[0, 0])


def test_scans_of_one_drive_go_on_from_each_other_and_others_do_not():
    world = office(seed=3)
    here, there, elsewhere = [2.0, 2.0, 0.3], [2.5, 2.15, 0.4], [9.0, 7.0, 2.0]
    scans = [scan_at(world, np.array(pose)) for pose in (here, there, elsewhere)]
    source = ScanContinuity()
    assert source.step(scans[0], None) is None
    step = drive(0.55, 0.0, 0.15)
    assert source.step(scans[1], step).doubt == 0
    assert source.step(scans[2], drive(0.0)).doubt > 0.5


def test_a_robot_whose_wheels_stand_still_is_doubted_where_one_that_drove_is_not():
    world = office(seed=3)
    scans = [scan_at(world, np.array(pose)) for pose in ([2.0, 2.0, 0.3], [3.2, 2.3, 0.3])]
    doubts = []
    for step in (drive(0.0), drive(1.24)):
        source = ScanContinuity()
        source.step(scans[0], None)
        doubts.append(source.step(scans[1], step).doubt)
    assert doubts[0] > 0.5 > doubts[1] == 0.0


def test_at_rest_a_wall_two_decimetres_off_is_another_one_and_on_the_way_the_same():
    around = {"angle_min": 0.0, "angle_increment": 2 * np.pi / 90, "range_max": 8.0}
    narrow, wide = (Scan.make(np.full(90, radius), **around) for radius in (3.0, 3.2))
    doubts = []
    for step in (drive(0.0), drive(1.0)):
        source = ScanContinuity()
        source.step(narrow, None)
        doubts.append(source.step(wide, step).doubt)
    assert doubts[0] > 0.5 > doubts[1] == 0.0


def test_a_scan_without_hits_is_doubted_by_nobody():
    blind = Scan.make(np.full(20, np.inf), angle_min=-1, angle_increment=0.1, range_max=8)
    source = ScanContinuity()
    assert source.step(blind, None) is None
    assert source.step(blind, drive()) is None


def test_end_points_are_the_hits_in_the_frame_of_the_laser():
    scan = Scan.make([1.0, np.inf, 2.0], angle_min=0.0, angle_increment=np.pi / 4, range_max=8)
    np.testing.assert_allclose(end_points(scan, 9), [[1, 0], [0, 2]], atol=1e-6)


def test_results_of_the_matcher_become_poses_in_the_home_nodes_of_their_references():
    class Result:
        valid = np.array([True, True, False])
        probability = np.array([0.9, 0.001, 0.0])
        reference = np.array([1, 2, -1])
        T_ref_query = np.array([[0.5, 0.1, 0.2], [0, 0, 0], [0, 0, 0]])
        covariance = np.tile(0.01 * np.eye(3), (3, 1, 1))

    (found,) = estimates(Result(), corridor())
    assert (found.place.node, found.reference, found.probability) == (1, 1, 0.9)
    np.testing.assert_allclose(found.place.T_node_laser, [0.5, 0.1, 0.2])
    assert MatchedSource.reads != AprSource.reads


def test_poses_of_two_nodes_are_compared_along_the_arcs_with_their_error():
    near = Neighbours(corridor(deviation=0.1), 12.0)
    T, way, turn = near.off(Place(0, np.array([3.0, 0, 0])), Place(1, np.array([0.0, 1.0, 0.5])))
    np.testing.assert_allclose(T, [1, 1, 0.5])
    assert way > 0.1
    assert turn == pytest.approx(0.01)


def test_a_hypothesis_is_told_from_the_reference_that_confirmed_it():
    world = corridor()
    made = sure(world=world, node=0)
    made.move(step=drive(3.5))
    near = Neighbours(world, 12.0)
    reference, T_ref_laser = seen_from(made.belief.best, near, world)
    assert world.appearances[reference].scan == 10
    np.testing.assert_allclose(T_ref_laser, [3.5, 0, 0])


def test_without_that_reference_the_nearest_of_the_home_node_is_taken_or_one_around_it():
    world = corridor()
    made = sure(world=world, node=1, x=1.5)
    near = Neighbours(world, 12.0)
    world.remove_references([1])
    reference, T_ref_laser = seen_from(made.belief.best, near, world)
    assert world.appearances[reference].scan == 12
    np.testing.assert_allclose(T_ref_laser, [-2.5, 0, 0], atol=1e-9)
    world.remove_references([0, 2])
    assert seen_from(made.belief.best, near, world) is None


class Aligned:
    """Stands for the kernel, which costs seconds of compilation."""

    def __init__(self, T, agreement):
        self.T, self.agreement = T, agreement

    def __call__(self, first, second, starts, config):
        assert starts.shape == (7, 3)
        return alignment.Aligned(self.T, 1e-4 * np.eye(3), np.array(self.agreement))


@pytest.fixture
def scan_motion(monkeypatch):
    """Makes a source that has seen a scan, and the scan; the views are not computed."""
    scan = Scan.make(np.ones(9), angle_min=-1.0, angle_increment=0.25, range_max=8.0)

    def make(T, agreement=0.5):
        view = SimpleNamespace(xy=np.zeros((9, 2)))
        monkeypatch.setattr(motion, "view_of", lambda scan, features: view)
        monkeypatch.setattr(motion, "align_two", Aligned(np.array(T), agreement))
        source = motion.ScanMotion()
        assert source.step(scan, None) is None
        return source, scan

    return make


def test_scans_that_agree_measure_the_step(scan_motion):
    source, scan = scan_motion([1.0, 0.0, 0.2])
    step = source.step(scan, drive(1.05, 0.0, 0.25, deviation=0.1))
    np.testing.assert_allclose(step.T_before_now, [1.0, 0.0, 0.2])
    assert step.covariance[2, 2] < 0.02**2


@pytest.mark.parametrize(("T", "agreement"), [([1.0, 0, 0.2], 0.05), ([3.0, 0, 1.5], 0.5)])
def test_scans_that_disagree_or_contradict_odometry_measure_nothing(scan_motion, T, agreement):
    source, scan = scan_motion(T, agreement)
    assert source.step(scan, drive(1.0, 0.0, 0.2, deviation=0.1)) is None


def test_scans_measure_nothing_without_odometry_to_start_from(scan_motion):
    source, scan = scan_motion([1.0, 0, 0])
    assert source.step(scan, None) is None


def test_scan_motion_is_restored_with_the_last_scan(scan_motion):
    source, scan = scan_motion([1.0, 0, 0])
    restored = motion.ScanMotion()
    restored.restore(json.loads(json.dumps(source.state())))
    assert json.dumps(restored.state()) == json.dumps(source.state())
    assert restored.step(scan, drive(deviation=0.1)) is not None


def outcome(converged=True, paired=0.7, T=(0.1, 0.0, 0.05)):
    """What iterative dual correspondence says of four pairs."""
    return Idc(
        np.tile(np.array(T), (4, 1)),
        np.tile(1e-4 * np.eye(3), (4, 1, 1)),
        np.zeros(4),
        np.full(4, paired),
        np.full(4, converged),
    )


@pytest.fixture
def judged_by_idc(monkeypatch):
    """Verdicts on hypotheses, given the kernel's outcome."""

    def judge(found, hypotheses, world):
        monkeypatch.setattr(validation.IdcSource, "_compare", lambda *_: found)
        return validation.IdcSource().judge(None, hypotheses, world)

    return judge


def unconfirmed(x=0.0):
    world = corridor()
    made = sure(world=world)
    made.move(step=drive(x))
    made.move(step=drive(1e-3))
    return made.hypotheses, world


def test_idc_that_converges_in_the_volume_confirms_and_refines(judged_by_idc):
    hypotheses, world = unconfirmed()
    (verdict,) = judged_by_idc(outcome(), hypotheses, world)
    assert verdict.likelihood == validation.IdcSourceConfig().found > 1
    assert (verdict.place.node, verdict.reference) == (0, 0)
    np.testing.assert_allclose(verdict.place.T_node_laser, [0.1, 0, 0.05])


@pytest.mark.parametrize(
    "found", [outcome(paired=0.5), outcome(converged=False), outcome(T=(2.0, 0, 0))]
)
def test_idc_that_pairs_few_hits_or_converges_elsewhere_or_not_says_nothing(judged_by_idc, found):
    (verdict,) = judged_by_idc(found, *unconfirmed())
    assert (verdict.likelihood, verdict.place) == (1, None)


def test_idc_says_nothing_where_no_reference_is_near(judged_by_idc):
    hypotheses, world = unconfirmed(2.0)
    world.remove_references([1, 2])
    hypotheses = tuple(h.moved(drive(3.0), VolumeConfig()) for h in hypotheses)
    (verdict,) = judged_by_idc(outcome(T=(5.0, 0, 0)), hypotheses, world)
    assert verdict.likelihood == 1


def test_idc_is_asked_after_turning_on_the_spot(judged_by_idc):
    world = corridor()
    hypotheses = tuple(
        h.moved(Step(np.array([0, 0, 0.1]), np.diag([0.0, 0.0, 1e-4])), VolumeConfig())
        for h in sure(world=world).hypotheses
    )
    (verdict,) = judged_by_idc(outcome(), hypotheses, world)
    assert verdict.likelihood > 1


def test_idc_does_not_count_a_scan_again_that_has_just_confirmed(judged_by_idc):
    world = corridor()
    (verdict,) = judged_by_idc(outcome(), sure(world=world).hypotheses, world)
    assert verdict.likelihood == 1


def test_idc_finds_a_reference_far_from_the_home_node(judged_by_idc):
    for x, ahead in ((4.0, 0.0), (7.0, -1.0), (8.0, 0.0)):
        made = sure(world=(world := corridor(nodes=6)))
        made.move(step=drive(x))
        world.remove_references([0])
        (verdict,) = judged_by_idc(outcome(T=(ahead, 0, 0)), made.hypotheses, world)
        assert verdict.likelihood > 1
