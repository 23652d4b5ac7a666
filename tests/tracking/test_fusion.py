"""Steps of several sources as one, and sources that read at rates of their own."""

import json

import numpy as np
import pytest

from aprjax.plane import compose, relative
from aprjax.tracking.fusion import Motion, filled, fuse
from aprjax.tracking.hypothesis import Step
from tests.tracking.worlds import drive

GYRO = Step(np.array([0, 0, 0.5]), np.diag([np.inf, np.inf, 1e-4]))
AHEAD = np.array([0.1, 0.0, 0.02])


def test_one_measured_step_is_passed_on_as_it_is():
    step = drive(1.0, 0.2, 0.1, deviation=0.1)
    fused = fuse([step, Step.unmeasured()])
    np.testing.assert_array_equal(fused.T_before_now, step.T_before_now)
    np.testing.assert_array_equal(fused.covariance, step.covariance)


def test_two_measured_steps_are_weighed_by_their_covariances():
    fused = fuse([drive(1.0, deviation=0.1), drive(2.0, deviation=0.2)])
    assert fused.T_before_now[0] == pytest.approx(1.2)
    assert fused.covariance[0, 0] == pytest.approx(0.1**2 * 0.2**2 / (0.1**2 + 0.2**2))


def test_turns_of_two_sources_are_averaged_across_the_half_turn():
    fused = fuse([drive(0, 0, 3.1, 0.1), drive(0, 0, -3.1, 0.1)])
    assert abs(fused.T_before_now[2]) == pytest.approx(np.pi, abs=1e-6)


def test_what_no_source_measured_stays_so_until_it_is_given_a_variance():
    fused = fuse([GYRO, GYRO])
    np.testing.assert_array_equal(fused.known, [False, False, True])
    whole = filled(fused, np.full(3, 0.09))
    np.testing.assert_allclose(whole.T_before_now, [0, 0, 0.5], atol=1e-9)
    np.testing.assert_allclose(np.diag(whole.covariance), [0.09, 0.09, 5e-5], rtol=1e-6)


def test_doubts_of_several_sources_add_up():
    assert fuse([drive(doubt=0.5), Step.unmeasured(0.5)]).doubt == pytest.approx(0.75)


def test_a_covariance_of_one_direction_is_fused():
    along = np.outer([1e4, 1e4, 0], [1.0, 1.0, 0])
    fused = fuse([Step(np.zeros(3), along), drive(1.0, deviation=0.1)])
    assert np.all(np.isfinite(fused.covariance))


class Measured:
    """Says how the robot moved since its last reading, or the numbers of it in `known`."""

    def __init__(self, reads, deviation=0.01, known=(True, True, True), off=(0.0, 0.0, 0.0)):
        self.reads, self.known = reads, np.array(known)
        self.variance, self.off = deviation**2, np.array(off)
        self.last = None
        self.expected = []
        self.fails = []
        """Which of the next readings it does not take."""

    def step(self, reading, expected):
        if self.fails and self.fails.pop(0):
            raise ValueError("no reading")
        last, self.last = self.last, reading
        self.expected.append(expected)
        if last is None:
            return None
        variance = np.where(self.known, self.variance, np.inf)
        return Step(np.where(self.known, relative(last, reading) + self.off, 0), np.diag(variance))


def gyro():
    return Measured("gyro", 0.001, (False, False, True))


def asked(source, reading, expected):
    """As the tracker asks: who raises has not taken the reading."""
    try:
        return True, source.step(reading, expected)
    except ValueError:
        return False, None


def driven(sources, calls, motion=None):
    """How far dead reckoning is off after the calls, and the sum of its variances after each.

    A call is the names that read in it. Before it the robot goes 0.1 m ahead and turns 0.02.
    """
    motion = Motion(0.3) if motion is None else motion
    pose = believed = np.array([3.0, 1.0, 0.4])
    added = [np.zeros(3)]
    for names in calls:
        step = motion.step(sources, dict.fromkeys(names, pose), asked)
        if step is not None:
            believed = compose(believed, step.T_before_now)
        added.append(added[-1] + (0.0 if step is None else np.diag(step.covariance)))
        last, pose = pose, compose(pose, AHEAD)
    return relative(last, believed), np.array(added)


BOTH = ("wheels", "scan")


@pytest.mark.parametrize("few", ["wheels", "scan"])
def test_a_source_that_reads_seldomer_is_not_averaged_with_a_part_of_its_step(few):
    calls = [BOTH, *[(few,)] * 4] * 8 + [BOTH]
    off, _ = driven([Measured("wheels"), Measured("scan")], calls)
    np.testing.assert_allclose(off, 0.0, atol=1e-9)


def test_a_seldom_and_surer_source_corrects_the_sum_of_what_others_measured():
    def slipping():
        return Measured("wheels", 0.05, off=(0.02, 0.0, 0.0))

    calls = [BOTH, *[("wheels",)] * 4] * 8 + [BOTH]
    alone, sure_of = driven([slipping()], [("wheels",)] * len(calls))
    off, added = driven([slipping(), Measured("scan", 0.001)], calls)
    assert alone[0] > 0.5
    assert abs(off[0]) < 0.02
    assert np.all(added[-1] <= sure_of[-1] + 1e-9)


def test_a_correction_in_a_call_of_its_own_is_not_taken_back_by_the_next_step():
    calls = [BOTH, *[("wheels",), ("wheels",), ("scan",)] * 6]
    slipping = Measured("wheels", 0.05, off=(0.02, 0.0, 0.0))
    off, _ = driven([slipping, Measured("scan", 0.001)], calls)
    # What the wheels do not see between their last reading and the scan's, the scan adds.
    assert abs(off[0]) < 0.15


def test_a_gyro_that_reads_often_leaves_the_way_to_the_wheels():
    together = [("gyro", "wheels"), *[("gyro",)] * 9] * 5 + [("gyro", "wheels")]
    off, added = driven([Measured("wheels"), gyro()], together)
    np.testing.assert_allclose(off, 0.0, atol=0.02)
    # Until wheels have told of a way for the first time, there may have been any.
    assert added[-1][0] - added[11][0] < 0.001


def test_a_gyro_and_wheels_that_never_read_in_one_call_agree():
    apart = [("wheels",), *[("gyro",)] * 9] * 5 + [("wheels",)]
    off, added = driven([Measured("wheels"), gyro()], apart)
    # The way is 5 m; who has not read since the last turn of 0.02 does not know of it.
    assert np.all(np.abs(off) < [0.15, 0.15, 0.04])
    assert added[-1][0] - added[11][0] < 0.001


@pytest.mark.parametrize("failing", [[0, 0, 1], [0, 0, 1, 1, 1], [0, 1] * 20])
@pytest.mark.parametrize("apart", [False, True])
def test_readings_that_a_source_does_not_take_lose_and_double_no_motion(failing, apart):
    wheels, scan = Measured("wheels"), Measured("scan", 0.02)
    wheels.fails = list(failing)
    calls = [("wheels",), ("scan",)] * 20 if apart else [BOTH] * 40
    off, _ = driven([wheels, scan], [*calls, BOTH])
    # Apart, each is off by the step that the other read last.
    assert abs(off[0]) < (0.25 if apart else 1e-6)


def test_a_source_that_starts_anew_goes_on_from_there():
    wheels, scan = Measured("wheels"), Measured("scan")
    scan.step = lambda reading, expected: None  # as one that never finds an overlap
    calls = [*[("wheels",)] * 4, ("scan",)] * 6
    motion = Motion(0.3)
    driven([wheels, scan], calls[:10], motion)
    wheels.last = None
    off, _ = driven([wheels, scan], calls, motion)
    # One step is not told of: that over which it started anew.
    assert abs(off[0]) < 0.25


def test_a_slow_gyro_turns_what_knows_its_way_alone():
    way = Measured("speed", known=(True, True, False))
    calls = [("speed", "gyro"), *[("speed",)] * 4] * 8 + [("speed", "gyro")]
    off, _ = driven([way, gyro()], calls)
    assert abs(off[2]) < 1e-3
    assert np.hypot(off[0], off[1]) < 0.3


def test_numbers_between_a_fast_gyro_and_a_slow_scanner_are_the_wheels():
    sources = [gyro(), Measured("wheels"), Measured("scan")]
    three = ("gyro", "wheels", "scan")
    driven(sources, [three, *[("gyro",)] * 4, ("gyro", "wheels"), *[("gyro",)] * 4, three])
    expected = sources[2].expected[-1]
    assert expected.T_before_now[0] == pytest.approx(1.0, abs=0.05)
    assert expected.covariance[0, 0] < 0.01


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_two_late_sources_of_one_name_the_surer_counts_more_in_either_order(order):
    both = [Measured("scan", 0.001), Measured("scan", 0.03, off=(0.2, 0.0, 0.0))]
    sources = [Measured("wheels", 0.1), *(both[k] for k in order)]
    off, _ = driven(sources, [BOTH, *[("wheels",)] * 4] * 8 + [BOTH])
    assert abs(off[0]) < 0.02


def test_a_gyro_alone_lets_the_place_grow_uncertain():
    _, added = driven([gyro()], [("gyro",)] * 3)
    assert added[-1][0] == pytest.approx(2 * 0.09)


def test_a_scan_that_no_motion_led_to_is_not_held_against_more_motion_than_it_saw():
    sources = [Measured("wheels"), Measured("scan")]
    sources[1].step = lambda reading, expected: sources[1].expected.append(expected)
    driven(sources, [BOTH, ("scan",), BOTH, BOTH])
    # Wheels tell of two steps, of which the last scan saw one; after that, of the same.
    assert [each is None for each in sources[1].expected] == [True, True, True, False]


def test_a_late_source_is_told_the_motion_since_its_own_last_reading():
    sources = [Measured("wheels"), Measured("scan")]
    driven(sources, [BOTH, ("wheels",), ("wheels",), ("scan",)])
    expected = sources[1].expected[-1]
    np.testing.assert_allclose(expected.T_before_now, compose(AHEAD, AHEAD), atol=1e-9)
    np.testing.assert_allclose(expected.covariance[2, 2], 2e-4, rtol=1e-6)


def test_saved_and_restored_it_goes_on_to_the_bit():
    calls = [BOTH, *[("gyro",)] * 3, ("wheels",), ("gyro",), ("scan",), ("scan",)] * 3

    def sources():
        return [Measured("wheels", 0.02), gyro(), Measured("scan", 0.005)]

    motion, ours, theirs = Motion(0.3), sources(), sources()
    driven(ours, calls[:-2], motion)
    again = Motion(0.3)
    again.restore(json.loads(json.dumps(motion.state())))
    for one, other in zip(theirs, ours, strict=True):
        one.last = other.last
    for left, right in zip(driven(ours, calls, motion), driven(theirs, calls, again), strict=True):
        np.testing.assert_array_equal(left, right)
