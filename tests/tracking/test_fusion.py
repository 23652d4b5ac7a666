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

    def step(self, reading, expected):
        last, self.last = self.last, reading
        self.expected.append(expected)
        if last is None:
            return None
        variance = np.where(self.known, self.variance, np.inf)
        return Step(np.where(self.known, relative(last, reading) + self.off, 0), np.diag(variance))


def gyro():
    return Measured("gyro", 0.001, (False, False, True))


def asked(source, reading, expected):
    return source.step(reading, expected)


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
