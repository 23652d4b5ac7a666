import inspect
import json
import logging
from dataclasses import replace

import numpy as np
import pytest

from aprjax.matcher import MatchConfig
from aprjax.plane import compose, distance
from aprjax.tracking.belief import Belief, Situation
from aprjax.tracking.evidence import EvidenceConfig
from aprjax.tracking.hypothesis import Step, VolumeConfig
from aprjax.tracking.odometry import Gyro, WheelOdometry
from aprjax.tracking.sources import Estimate, Verdict
from aprjax.tracking.tracker import HypothesisTracker, TrackerConfig
from aprjax.tracking.validation import IdcSource
from aprjax.world.parts import Place
from tests.tracking.worlds import (
    EXACT,
    Driven,
    Told,
    approve,
    at,
    corridor,
    drive,
    sure,
    total,
    tracker,
)
from tests.worlds import office, scan_at

CONFIG = EvidenceConfig()


def only(made):
    assert len(made.hypotheses) == 1
    return made.hypotheses[0]


# Creation


def test_an_estimate_in_no_volume_becomes_a_hypothesis_of_low_probability_in_its_home_node():
    made = tracker()
    made.observe(estimates=[at(1, 0.5, 0.2, 0.3)])
    new = only(made)
    assert new.place.node == 1
    np.testing.assert_array_equal(new.place.T_node_laser, [0.5, 0.2, 0.3])
    assert 0 < new.probability <= CONFIG.initial
    assert made.rest == pytest.approx(1 - new.probability)


def test_a_better_estimate_begins_with_more():
    begun = []
    for probability in (0.2, 0.8):
        made = tracker()
        made.observe(estimates=[at(probability=probability)])
        begun.append(only(made).probability)
    assert begun[0] < begun[1]


def test_a_new_hypothesis_takes_from_the_rest_and_begins_with_little_where_that_is_small():
    lost, tracking = tracker(), sure()
    lost.observe(estimates=[at(2, probability=0.98)])
    tracking.move(step=drive(1.0))
    tracking.observe(estimates=[at(0, 1.0), at(2, probability=0.98)])
    assert tracking.hypotheses[1].probability < 0.2 * only(lost).probability


def test_estimates_of_one_place_by_several_references_make_one_hypothesis():
    made = tracker()
    # Node 1 lies four metres ahead: all three are one pose.
    made.observe(estimates=[at(0, 4.0), at(1, 0.05, probability=0.95), at(2, -4.0)])
    assert only(made).place.node == 1
    assert only(made).reference == 1


# Confirmation


def test_a_confirmed_hypothesis_takes_the_estimate_as_centre_and_a_small_volume():
    made = sure()
    before = made.belief.best
    made.move(step=drive(1.0, deviation=0.3))
    grown = made.belief.best
    made.observe(estimates=[at(0, 1.2, 0.1, 0.05)])
    after = made.belief.best
    assert after.number == before.number
    np.testing.assert_allclose(after.place.T_node_laser, [1.2, 0.1, 0.05])
    assert grown.radius > after.radius == pytest.approx(before.radius)
    assert grown.unconfirmed > after.unconfirmed == 0


def test_of_several_estimates_in_a_volume_the_most_probable_confirms():
    made = sure()
    made.move(step=drive(1.0, deviation=0.6))
    made.observe(estimates=[at(0, 0.4, probability=0.4), at(0, 1.5, probability=0.9)])
    np.testing.assert_allclose(made.belief.best.place.T_node_laser[0], 1.5)


@pytest.mark.parametrize(("probability", "x"), [(0.05, 1.0), (0.15, 1.2)])
def test_an_estimate_moves_a_centre_if_it_is_rather_right_in_that_volume(probability, x):
    made = sure()
    made.move(step=drive(1.0))
    made.observe(estimates=[at(0, 1.2, probability=probability)])
    assert made.belief.best.place.T_node_laser[0] == pytest.approx(x)


def test_a_robot_that_passes_into_the_next_region_keeps_its_hypothesis():
    made = sure()
    number = made.belief.best.number
    for _ in range(4):
        made.move(step=drive(0.95, deviation=0.03))
    made.observe(estimates=[at(1, -0.1, 0.05)])
    after = made.belief.best
    assert (after.number, after.place.node, after.reference) == (number, 1, 1)
    np.testing.assert_allclose(after.place.T_node_laser, [-0.1, 0.05, 0])


@pytest.mark.parametrize(("deviation", "hypotheses"), [(0.02, 2), (0.5, 1)])
def test_the_error_of_an_arc_widens_the_volume_beyond_it(deviation, hypotheses):
    made = sure(world=corridor(deviation=deviation))
    made.move(step=drive(3.0))
    made.observe(estimates=[at(1, -0.1)])
    assert len(made.hypotheses) == hypotheses


def test_without_reach_a_robot_far_from_its_home_node_is_confirmed_there_alone():
    made = sure(config=TrackerConfig(reach=0.0))
    made.move(step=drive(1.0))
    made.observe(estimates=[at(0, 1.0), at(1, -3.0, 2.0)])
    assert made.belief.best.place.node == 0
    assert made.belief.best.unconfirmed == 0


def test_a_pose_that_no_arcs_lead_to_confirms_nothing():
    world = corridor(nodes=12)
    world.remove_arc(5, 6)
    made = sure(world=world)
    made.move(step=drive(1.0))
    made.observe(estimates=[at(11, -43.0)])
    assert len(made.hypotheses) == 2


def test_a_robot_that_drove_far_from_its_home_node_is_still_confirmed():
    made = sure(world=corridor(nodes=12))
    number = made.belief.best.number
    for _ in range(36):
        made.move(step=drive(1.0, deviation=0.02))
    far, near = made.belief.best.place, at(9).place
    assert made._near.off(far, near) is not None
    assert made._near.off(near, far) is not None
    made.observe(estimates=[at(9)])
    assert (made.belief.best.number, made.belief.best.place.node) == (number, 9)


# Reward, punishment, deletion, the rest


def test_rewards_grow_with_the_probability_of_the_estimate():
    left = []
    for probability in (0.3, 0.6, 0.9):
        made = tracker()
        made.observe(estimates=[at(probability=0.5)])
        made.move(step=drive())
        made.observe(estimates=[at(0, 1.0, probability=probability)])
        left.append(only(made).probability)
    assert left == sorted(set(left))


def test_the_most_probable_hypothesis_comes_first_after_a_move_too():
    made = tracker()
    large = replace(only(sure()), number=0, probability=0.5, covariance=np.diag([4.0, 4.0, 0.01]))
    small = replace(only(sure()), number=1, probability=0.45)
    made.belief = Belief((large, small), 0.05, 2)
    for _ in range(8):
        made.move(step=drive(0.5, deviation=1.0))
        probabilities = [h.probability for h in made.hypotheses]
        assert probabilities == sorted(probabilities, reverse=True)
    assert made.belief.best.number == 1


def test_an_unconfirmed_hypothesis_is_punished_by_the_likelihood_of_a_miss():
    made = tracker()
    made.observe(estimates=[at(0), at(2)])
    made.move(step=drive())
    before = {h.number: h.probability / made.rest for h in made.hypotheses}
    made.observe(estimates=[at(0, 1.0)])
    after = {h.number: h.probability / made.rest for h in made.hypotheses}
    confirmed = made.belief.best.number
    (other,) = set(after) - {confirmed}
    assert after[confirmed] > before[confirmed]
    assert after[other] == pytest.approx(before[other] * CONFIG.missed)


def test_a_hypothesis_under_the_threshold_is_deleted_and_the_rest_has_its_share():
    made = tracker()
    made.observe(estimates=[at(0)])
    for _ in range(10):
        made.move(step=drive())
        made.observe(estimates=[])
    assert made.hypotheses == ()
    assert made.rest == 1.0


def test_the_rest_grows_while_nothing_is_confirmed_and_shrinks_when_something_is():
    made = sure()
    rests = []
    for _ in range(3):
        made.move(step=drive())
        made.observe(estimates=[])
        rests.append(made.rest)
    assert rests == sorted(set(rests))
    made.move(step=drive())
    made.observe(estimates=[at(1, 0.0)])
    assert made.rest < rests[-1]


def test_the_rest_never_vanishes():
    made = sure(times=50)
    assert made.rest == pytest.approx(float(CONFIG.rest))


def test_the_probabilities_sum_to_one_at_every_step():
    rng = np.random.default_rng(3)
    made = tracker(corridor(nodes=5))
    for _ in range(300):
        act = rng.integers(4)
        if act == 0:
            made.move(step=drive(rng.uniform(0, 1), deviation=0.1, doubt=rng.choice([0.0, 0.9])))
        elif act == 1:
            made.observe(verdict=lambda h: Verdict(rng.uniform(0, 5)))
        else:
            seen = [
                at(
                    int(rng.integers(5)),
                    *rng.uniform(-2, 2, 3),
                    probability=rng.choice([0, 0.3, 1.0]),
                )
                for _ in range(rng.integers(4))
            ]
            made.observe(estimates=seen)
        values = [h.probability for h in made.hypotheses]
        assert total(made.belief) == pytest.approx(1, abs=1e-12)
        assert values == sorted(values, reverse=True)
        assert all(value >= 0 for value in [*values, made.rest])


def test_no_more_hypotheses_than_the_capacity_are_kept_and_the_strongest_are():
    config = TrackerConfig(evidence=EvidenceConfig(hypotheses=3))
    made = tracker(corridor(nodes=8), config=config)
    made.observe(estimates=[at(n, probability=0.1 * (n + 1)) for n in range(8)])
    assert {h.place.node for h in made.hypotheses} == {5, 6, 7}
    assert total(made.belief) == pytest.approx(1)


def test_hypotheses_that_meet_become_one():
    made = tracker()
    made.observe(estimates=[at(0, 0.0), at(0, 1.0)])
    assert len(made.hypotheses) == 2
    made.observe(verdict=lambda h: Verdict(2.0, Place(0, np.array([0.5, 0, 0])), EXACT))
    assert len(made.hypotheses) == 1


# Standing still, and the kidnapped robot


def test_a_false_match_repeated_at_standstill_adds_nothing():
    made = tracker()
    made.observe(estimates=[at()])
    once = only(made).probability
    for _ in range(100):
        made.move(step=drive(0.0))
        made.observe(estimates=[at()])
    assert only(made).probability == pytest.approx(once)


def test_the_same_way_gives_the_same_evidence_however_often_the_scanner_looks():
    found = []
    for steps in (2, 20):
        made = tracker()
        made.observe(estimates=[at(probability=0.5)])
        for step in range(steps):
            made.move(step=drive(1.0 / steps))
            made.observe(estimates=[at(0, (step + 1) / steps, probability=0.2)])
        found.append(only(made).probability)
    assert found[0] == pytest.approx(found[1], rel=0.02)


def test_a_robot_that_was_carried_away_is_found_again():
    made = sure(times=20)
    far = 0
    for step in range(8):
        made.move(step=drive(0.5, deviation=0.02))
        made.observe(estimates=[at(2, 0.5 * step, probability=0.97)])
        far = step
        if made.belief.situation is Situation.TRACKING and made.belief.best.place.node == 2:
            break
    assert 0.5 * (far + 1) <= 3.0


def test_a_doubted_step_moves_weight_to_the_rest_and_makes_evidence_new():
    made = sure()
    before = made.belief.best.probability
    made.move(step=drive(0.0, doubt=0.9))
    assert made.belief.best.probability == pytest.approx(0.1 * before)
    doubted = made.belief.best.probability
    made.observe(estimates=[at(probability=0.99)])
    assert made.belief.best.probability > doubted


# Tracking


def test_volumes_grow_with_the_way_and_the_proportions_of_the_probabilities_stay():
    made = tracker()
    made.observe(estimates=[at(0, probability=0.9), at(2, probability=0.3)])
    before = made.hypotheses
    made.move(step=drive(1.0, deviation=0.1))
    after = made.hypotheses
    for old, new in zip(before, after, strict=True):
        assert new.number == old.number
        assert new.radius > old.radius
        assert new.angle > old.angle
        assert distance(new.place.T_node_laser - old.place.T_node_laser) == pytest.approx(1.0)
    ratio = [hs[0].probability / hs[1].probability for hs in (before, after)]
    assert ratio[0] == pytest.approx(ratio[1])


def test_a_gyro_makes_headings_better_than_odometry_alone_has_them():
    poses = np.array([[0, 0, 0], [1.0, 0, 0.3]])
    spreads = []
    for sources in ([WheelOdometry()], [WheelOdometry(), Gyro()]):
        made = tracker(tracking=sources)
        made.observe(estimates=[at()])
        for pose, heading in zip(poses, (0.0, 0.25), strict=True):
            made.move(odometry=pose, gyro=heading)
        spreads.append((made.belief.best.place.T_node_laser[2], made.belief.best.angle))
    assert spreads[0][0] == pytest.approx(0.3)
    assert spreads[1][0] == pytest.approx(0.25, abs=0.01)
    assert spreads[1][1] < spreads[0][1]


# Validation


def test_a_validation_source_creates_nothing():
    made = tracker()
    made.observe(verdict=approve(5.0))
    assert made.hypotheses == ()
    assert made.rest == 1.0


def test_a_validation_source_confirms_and_refines():
    made = tracker()
    made.observe(estimates=[at(0), at(2)])
    better = Place(0, np.array([0.1, 0.0, 0.0]))
    made.observe(
        verdict=lambda h: Verdict(4.0, better, EXACT) if h.place.node == 0 else Verdict(1.0)
    )
    assert made.belief.best.place.node == 0
    np.testing.assert_array_equal(made.belief.best.place.T_node_laser, better.T_node_laser)
    assert made.hypotheses[0].probability == pytest.approx(4 * made.hypotheses[1].probability)


def test_a_verdict_that_weakens_does_not_move_a_centre():
    made = sure()
    before = made.belief.best.place
    made.observe(verdict=approve(0.5, place=Place(0, np.ones(3)), covariance=EXACT))
    assert made.belief.best.place is before


def test_a_validation_source_can_reject():
    made = sure()
    made.observe(verdict=approve(0.001))
    assert made.belief.situation is Situation.LOST


# The answer


def test_who_has_seen_nothing_is_lost():
    belief = tracker().belief
    assert (belief.situation, belief.probability, belief.covariance) == (Situation.LOST, 1.0, None)


def test_who_has_one_strong_hypothesis_is_tracking_and_has_a_covariance():
    belief = sure().belief
    assert belief.situation is Situation.TRACKING
    assert belief.probability == belief.best.probability > 0.9
    assert np.all(np.linalg.eigvalsh(belief.covariance) > 0)


def test_two_places_alike_are_ambiguous():
    made = tracker()
    for step in range(4):
        made.observe(estimates=[at(0, 1.0 * step), at(2, 1.0 * step)])
        made.move(step=drive())
    belief = made.belief
    assert belief.situation is Situation.AMBIGUOUS
    assert belief.probability == pytest.approx(1 - belief.rest)
    assert belief.covariance is None


# Sources that fail


class Broken:
    reads = "estimates"

    def locate(self, reading, world):
        raise RuntimeError("no camera")

    def step(self, reading, expected):
        raise RuntimeError("no wheels")

    def judge(self, reading, hypotheses, world):
        raise RuntimeError("no judge")


def test_a_source_that_raises_is_logged_and_the_tracker_goes_on(caplog):
    made = tracker(primary=[Broken(), Told()], tracking=[Broken()], validation=[Broken()])
    with caplog.at_level(logging.WARNING):
        made.move(estimates=[])
        made.observe(estimates=[at()])
    assert only(made).place.node == 0
    assert [text for text in ("no camera", "no wheels", "no judge") if text in caplog.text] == [
        "no camera",
        "no wheels",
        "no judge",
    ]


def test_a_reading_that_no_source_takes_is_said_once_and_left_out(caplog):
    made = sure()
    before = made.belief
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            assert made.move(odometri=drive()) is before
            assert made.observe(step=drive(), scans=None) is before
    said = [record.getMessage() for record in caplog.records]
    assert said == ["move: no source reads 'odometri'", "observe: no source reads 'scans'"]


class Dumb:
    def step(self, reading, expected):
        return None


@pytest.mark.parametrize(
    ("sources", "problem"),
    [
        ({"tracking": [Dumb()]}, r"tracking\[0\]: Dumb does not say what it reads"),
        ({"validation": [Broken(), Told()]}, r"validation\[1\]: Told has no method judge"),
        ({"primary": [Broken]}, r"primary\[0\]: Broken is a class"),
        ({"primary": Broken()}, "primary: Broken is no list of sources"),
    ],
)
def test_what_is_no_source_is_refused_by_name(sources, problem):
    with pytest.raises(ValueError, match=problem):
        tracker(**sources)


def test_a_path_is_no_world_model_and_rules_of_matching_are_none_of_tracking():
    with pytest.raises(ValueError, match="world: str is no WorldModel"):
        HypothesisTracker("office.map")
    with pytest.raises(ValueError, match="config: MatchConfig is no TrackerConfig"):
        tracker(config=MatchConfig())


@pytest.mark.parametrize(
    "estimate",
    [
        at(99),
        at(0, np.nan),
        at(0, probability=1.5),
        Estimate(Place(0, np.zeros(3)), np.full((3, 3), np.inf), 0.5),
    ],
)
def test_an_estimate_that_means_nothing_is_left_out(estimate, caplog):
    made = tracker()
    made.observe(estimates=[estimate, at(1)])
    assert only(made).place.node == 1
    assert "left out" in caplog.text


@pytest.mark.parametrize(
    "verdicts",
    [
        [],
        [Verdict(np.nan)],
        [Verdict(-1.0)],
        [Verdict(1.0, Place(0, np.full(3, np.nan)))],
        [Verdict(1.0, Place(0, np.zeros(3)), np.full((3, 3), np.inf))],
        [None],
        3,
    ],
)
def test_verdicts_that_mean_nothing_are_left_out(verdicts):
    class Odd:
        reads = "verdict"

        def judge(self, reading, hypotheses, world):
            return verdicts

    made = sure(validation=[Odd()])
    before = made.belief
    assert made.observe(verdict=0) is before


@pytest.mark.parametrize(
    "step", [drive(np.nan), drive(1e300), drive(doubt=np.nan), "north", [], Step(EXACT, EXACT)]
)
def test_a_step_that_means_nothing_is_left_out(step):
    made = sure()
    before = made.belief
    assert made.move(step=step) is before


@pytest.mark.parametrize("estimates", [3, "here", [None], [[]]])
def test_what_are_no_estimates_is_left_out(estimates):
    made = sure()
    before = made.belief
    assert made.observe(estimates=estimates) is before


RANK_ONE = np.zeros((3, 3))
RANK_ONE[0, 0] = 1e8
HALF_KNOWN = np.diag([1.0, 1.0, 0.1])
HALF_KNOWN[0, 1] = HALF_KNOWN[1, 0] = np.inf


@pytest.mark.parametrize(
    "covariance",
    [
        -np.eye(3),
        np.diag([1e308] * 3),
        HALF_KNOWN,
        np.ones((3, 2)),
        np.full((3, 3), np.nan),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0, 0.8], [0.0, 1.0, 0.8], [0.8, 0.8, 1.0]]),
        np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_a_covariance_that_is_none_is_left_out(covariance):
    made = sure()
    before = made.belief
    assert made.move(step=Step(np.zeros(3), covariance)) is before
    estimate = Estimate(Place(0, np.zeros(3)), covariance, 0.9)
    assert made.observe(estimates=[estimate]).best.number == before.best.number
    verdict = Verdict(2.0, Place(0, np.zeros(3)), covariance)
    made.observe(verdict=lambda hypothesis: verdict)
    assert np.all(np.linalg.eigvalsh(made.belief.best.covariance) > 0)


def test_what_a_source_does_not_measure_moves_nothing():
    made = sure()
    before = made.belief.best.place.T_node_laser
    unmeasured = np.diag([np.inf, np.inf, 1e-4])
    made.move(step=Step(np.array([0.7, np.nan, 0.1]), unmeasured))
    np.testing.assert_allclose(made.belief.best.place.T_node_laser, before + np.array([0, 0, 0.1]))


@pytest.mark.parametrize("covariance", [EXACT.tolist(), RANK_ONE, np.full((3, 3), 0.01)])
def test_numbers_in_lists_and_extreme_ones_are_taken_beside_other_sources(covariance):
    made = sure(tracking=[Driven(), WheelOdometry()])
    made.move(odometry=[0.0, 0.0, 0.0])
    for x in (0.1, 0.2, 0.3):
        step = Step([0.1, 0.0, 0.0], covariance)
        made.move(step=step, odometry=[x, 0.0, 0.0])
        place = Place(0, [x, 0.0, 0.0])
        made.observe(verdict=lambda hypothesis, place=place: Verdict(1.5, place, covariance))
    assert np.all(np.isfinite(made.belief.best.covariance))
    assert total(made.belief) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("config", "field"), [(EvidenceConfig, "independence"), (TrackerConfig, "unmeasured")]
)
def test_a_configuration_that_divides_by_zero_is_refused(config, field):
    with pytest.raises(ValueError, match=field):
        config(**{field: 0.0})


# Sources at rates of their own


def test_odometry_that_reads_more_often_than_the_scanner_counts_once():
    world = office(seed=3)
    made = HypothesisTracker(corridor(), primary=[Told()], validation=[])
    made.observe(estimates=[at(probability=0.99)])
    start = np.array([2.0, 2.0, 0.3])
    for k in range(21):
        pose = compose(start, np.array([0.02 * k, 0.0, 0.0]))
        scan = {} if k % 5 else {"scan": scan_at(world, pose)}
        made.move(odometry=[0.02 * k, 0.0, 0.0], **scan)
    np.testing.assert_allclose(made.belief.best.place.T_node_laser, [0.4, 0, 0], atol=0.02)


# Time


def test_a_late_reading_that_is_left_out_does_no_harm():
    made = sure()
    made.move(stamp=100.0, step=drive(0.0))
    made.observe(stamp=100.0, estimates=[at(probability=0.99)])
    before = made.belief
    assert made.observe(stamp=60.0, estimates=[at(probability=0.99)]) is before
    made.observe(stamp=100.05, estimates=[at(probability=0.99)])
    assert made.belief.best.radius == pytest.approx(before.best.radius)


def test_readings_out_of_order_are_left_out(caplog):
    made = tracker()
    made.observe(stamp=10.0, estimates=[at()])
    before = made.belief
    assert made.observe(stamp=9.9, estimates=[at(2)]) is before
    assert "too late" in caplog.text
    made.observe(stamp=10.1, estimates=[at(2)])
    assert len(made.hypotheses) == 2


@pytest.mark.parametrize("back", [5.0, 30.0, 59.0, 90.0])
def test_a_clock_that_is_set_back_stops_the_tracker_for_two_readings_at_most(back, caplog):
    made = tracker(tracking=[WheelOdometry()])
    made.belief = sure().belief
    for k in range(50):
        stamp = 100.0 + 0.1 * k - (back if k >= 25 else 0.0)
        made.move(stamp=stamp, odometry=[0.05 * k, 0.0, 0.0])
        made.observe(stamp=stamp, verdict=approve(1.0))
    (best,) = made.hypotheses
    assert best.place.T_node_laser[0] == pytest.approx(0.05 * 49)
    assert len(caplog.messages) <= 4


def test_one_stamp_in_the_future_costs_two_readings_at_most():
    made = tracker(tracking=[WheelOdometry()])
    made.belief = sure().belief
    for k in range(50):
        made.move(stamp=100.0 + 0.1 * k + 30.0 * (k == 25), odometry=[0.05 * k, 0.0, 0.0])
        assert made.belief.best.place.T_node_laser[0] >= 0.05 * (k - 2) - 1e-9
    assert made.belief.best.place.T_node_laser[0] == pytest.approx(0.05 * 49)


def test_late_readings_that_do_not_follow_each_other_are_left_out_however_many():
    made = tracker()
    made.observe(stamp=10.0, estimates=[at()])
    before = made.belief
    for stamp in (9.9, 9.8, 9.7, 9.7, 9.7, 9.6, 9.65):
        assert made.observe(stamp=stamp, estimates=[at(2)]) is before


def test_repeated_readings_and_a_clock_that_stands_still_do_no_harm():
    made = tracker()
    for _ in range(5):
        made.move(stamp=3.0, step=drive(0.0))
        made.observe(stamp=3.0, estimates=[at()])
    assert only(made).probability <= CONFIG.initial
    made.move(stamp=3.0, step=drive(1.0))
    made.observe(stamp=3.0, estimates=[at(0, 1.0)])
    assert only(made).probability > CONFIG.initial


def test_silence_is_counted_once_whichever_clock_is_behind():
    grown = []
    for behind in (None, 0.9):
        made = sure()
        made.move(stamp=0.0, step=drive(0.0))
        before = made.belief.best
        for stamp in range(1, 31):
            made.observe(stamp=float(stamp), other=None)
            if behind is not None:
                made.observe(stamp=stamp - behind, another=None)
        grown.append((made.belief.best.covariance - before.covariance)[0, 0])
    assert grown[1] < 1.1 * grown[0]


def test_a_stamp_that_is_no_number_does_not_stop_the_clock_of_silence():
    made = sure()
    made.move(stamp=np.nan, step=drive(0.0))
    radius = made.belief.best.radius
    for stamp in range(100):
        made.observe(stamp=float(stamp), other=None)
    assert made.belief.best.radius > 2 * radius


def test_a_clock_that_is_set_back_does_not_stop_the_tracker(caplog):
    made = sure()
    made.observe(stamp=1e9, estimates=[at()])
    for step in range(3):
        made.move(stamp=5.0 + step, step=drive())
        made.observe(stamp=5.0 + step, estimates=[at(0, 1.0 + step)])
    assert "went back" in caplog.text
    assert made.belief.best.unconfirmed == 0


def test_a_stamp_that_is_no_number_is_as_good_as_none():
    made = tracker()
    made.observe(stamp=np.nan, estimates=[at()])
    assert only(made).place.node == 0


def test_minutes_without_odometry_make_volumes_grow_but_not_without_bound(caplog):
    made = tracker()
    made.move(stamp=0.0, step=drive())
    made.observe(stamp=0.0, estimates=[at()])
    radii = []
    for stamp in (1.0, 3.5, 600.0):
        made.observe(stamp=stamp, other=None)
        radii.append(made.belief.best.radius)
    assert radii[0] < radii[1] < radii[2] == pytest.approx(float(CONFIG.volume.largest))
    assert caplog.text.count("no motion measured") == 1


def test_in_silence_other_sources_find_the_robot_again():
    made = sure(world=corridor(nodes=12))
    made.move(stamp=0.0, step=drive(0.0))
    for stamp in range(1, 121):
        made.observe(stamp=float(stamp), estimates=[at(8, probability=0.9)])
    assert made.belief.best.place.node == 8
    assert made.belief.situation is Situation.TRACKING


def test_a_robot_that_hears_nothing_for_half_a_minute_is_lost_and_found_again():
    made = sure()
    made.move(stamp=0.0, step=drive(0.0))
    probabilities = [made.belief.best.probability]
    for stamp in range(5, 35, 5):
        made.observe(stamp=float(stamp), other=None)
        probabilities.append(made.belief.best.probability)
    assert made.belief.situation is Situation.LOST
    assert np.all(np.diff(probabilities) <= 0)
    assert made.rest == pytest.approx(1 - probabilities[-1])
    made.observe(stamp=31.0, estimates=[at(0, probability=0.99)])
    assert made.belief.situation is Situation.TRACKING
    assert made.belief.best.radius < 1.0


@pytest.mark.parametrize("deviation", [1e2, 3e4])
def test_steps_of_which_nothing_is_known_leave_nothing_but_the_rest(deviation):
    made = sure()
    for _ in range(3):
        made.move(step=drive(0.1, deviation=deviation))
    made.observe(estimates=[])
    assert made.rest == 1.0


def test_volumes_without_room_to_grow_are_taken():
    volume = VolumeConfig(radius=np.float32(0.0), angle=np.float32(0.0), largest=np.float32(0.0))
    made = sure(config=TrackerConfig(evidence=EvidenceConfig(volume=volume)))
    made.move(step=drive(1.0, deviation=0.0))
    made.observe(estimates=[at(0, 1.0)])
    assert made.belief.best.probability > 0.5
    assert total(made.belief) == pytest.approx(1.0)


def test_a_volume_within_its_bounds_holds_what_it_held_before():
    made = sure()
    before = made.belief.best
    made.move(step=Step(np.zeros(3), np.diag([0.1, 0.1, 0.01])))
    assert made.belief.best.radius > before.radius
    assert made.belief.best.probability == before.probability


def test_a_gyro_that_goes_on_does_not_hide_that_wheels_fell_silent():
    made = sure(tracking=[WheelOdometry(), Gyro()])
    for stamp in (0.0, 1.0):
        made.move(stamp=stamp, odometry=[0.0, 0.0, 0.0], gyro=0.0)
    radius = made.belief.best.radius
    for stamp in range(2, 60):
        made.move(stamp=float(stamp), gyro=0.0)
        made.observe(stamp=float(stamp), other=None)
    assert made.belief.best.radius > 3 * radius


def test_readings_that_no_source_takes_are_no_error():
    made = sure()
    before = made.belief
    assert made.move(wifi=3) is before
    assert made.observe(wifi=3) is before


# Saving


def test_a_saved_and_restored_tracker_goes_on_the_same_to_the_bit():
    def sources():
        return {"tracking": [WheelOdometry(), Gyro()]}

    def drive_on(made, steps, start):
        rng = np.random.default_rng(start)
        for k in range(start, start + steps):
            made.move(stamp=0.1 * k, odometry=[0.3 * k, 0.01 * k, 0.02 * k], gyro=0.019 * k)
            seen = [at(int(rng.integers(3)), *rng.uniform(-1, 1, 3), probability=rng.uniform())]
            made.observe(stamp=0.1 * k, estimates=seen, verdict=approve(rng.uniform(0.5, 2)))
        return made

    whole = drive_on(tracker(**sources()), 20, 0)
    saved = json.dumps(whole.state())
    restored = tracker(**sources())
    restored.restore(json.loads(saved))
    drive_on(whole, 20, 20)
    drive_on(restored, 20, 20)
    assert len(whole.hypotheses) > 2
    assert json.dumps(restored.state()) == json.dumps(whole.state())


def test_a_state_is_plain_numbers_whatever_sources_answer():
    made = tracker()
    estimate = at(np.int64(1), probability=np.float32(0.9))
    made.observe(estimates=[estimate])
    made.observe(verdict=approve(np.float32(0.9)))
    assert json.loads(json.dumps(made.state()))["belief"]["hypotheses"][0]["node"] == 1


def test_a_state_of_a_world_with_other_nodes_is_refused_and_changes_nothing():
    made = tracker(corridor(nodes=9))
    made.observe(estimates=[at(8)])
    small = sure()
    before = small.belief
    with pytest.raises(ValueError, match="node 8"):
        small.restore(made.state())
    assert small.belief is before


def test_a_state_of_other_sources_is_refused():
    with pytest.raises(ValueError, match="sources"):
        tracker(validation=[]).restore(tracker().state())


# A source of the user's own


class Beacon:
    """A radio beacon that is heard within three metres of a place."""

    reads = "beacon"

    def __init__(self, place):
        self.place = place

    def judge(self, reading, hypotheses, world):
        verdicts = []
        for hypothesis in hypotheses:
            same = hypothesis.place.node == self.place.node
            off = hypothesis.place.T_node_laser - self.place.T_node_laser
            near = same and np.hypot(off[0], off[1]) < 3.0
            verdicts.append(Verdict(4.0 if near == reading else 0.25))
        return verdicts


def test_a_beacon_is_a_source_in_twenty_lines():
    assert len(inspect.getsource(Beacon).splitlines()) <= 20
    made = tracker(validation=[Beacon(Place(2, np.zeros(3)))])
    made.observe(estimates=[at(0), at(2)])
    made.observe(beacon=True)
    assert made.belief.best.place.node == 2
    made.move(step=drive(0.0))
    made.move(step=drive(3.0, deviation=0.1))
    made.observe(beacon=True)
    made.observe(beacon=True)
    assert made.hypotheses[0].probability < 1


# Estimates that exclude each other


def test_estimates_of_several_places_reward_by_the_ratio_of_their_odds():
    alone, among = tracker(), tracker()
    for made in (alone, among):
        made.observe(estimates=[at(probability=0.6)])
        made.move(step=drive())
    alone.observe(estimates=[at(0, 1.0, probability=0.9)])
    others = [at(node, 0.5 * node, probability=0.95) for node in (1, 2)]
    among.observe(estimates=[at(0, 1.0, probability=0.9), *others])
    ratio = [made.hypotheses[0].probability / made.rest for made in (alone, among)]
    assert ratio[1] < 0.3 * ratio[0]


def test_an_estimate_in_a_volume_moves_the_centre_though_others_are_as_probable():
    made = sure()
    made.move(step=drive(1.0))
    made.observe(estimates=[at(0, 1.2), *(at(node, 1.0, 1.0) for node in (1, 2))])
    np.testing.assert_allclose(made.belief.best.place.T_node_laser[:2], [1.2, 0.0])


def test_by_default_iterative_dual_correspondence_validates():
    made = HypothesisTracker(corridor())
    assert [type(source) for source in made.validation] == [IdcSource]


def test_at_rest_estimates_of_other_places_take_from_the_rest_alone():
    made = tracker(corridor(nodes=12))
    made.observe(estimates=[at(0, probability=0.9)])
    before = only(made).probability
    for node in range(2, 12):
        made.observe(estimates=[at(node, probability=0.5)])
    assert made.hypotheses[0].probability == pytest.approx(before)
    made.observe(
        estimates=[at(node, 1.9, y, probability=0.01) for node in range(12) for y in (3, -3)]
    )
    assert made.hypotheses[0].probability == pytest.approx(before)
    assert total(made.belief) == pytest.approx(1.0)


def test_at_rest_an_estimate_of_another_place_begins_with_less_than_after_a_way():
    begun = []
    for way in (0.0, 1.0):
        made = tracker()
        made.observe(estimates=[at(0, probability=0.9)])
        made.move(step=drive(way))
        rest = made.rest
        made.observe(estimates=[at(2, probability=0.9)])
        begun.append(next(h for h in made.hypotheses if h.place.node == 2).probability / rest)
    assert begun[0] == pytest.approx(float(CONFIG.share), rel=0.1)
    assert begun[1] > 4 * begun[0]
