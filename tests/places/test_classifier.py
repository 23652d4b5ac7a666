import dataclasses

import numpy as np
import pytest

import aprjax
from aprjax.io.trajectory import read_tum
from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import scan_features
from aprjax.places.neural_gas import NeuralGasConfig
from aprjax.places.recognition import recognition
from aprjax.scan import Scan
from tests.worlds import free_pose, office, scan_at


@pytest.fixture(scope="module")
def scans():
    rng = np.random.default_rng(0)
    world = office(seed=5)
    return [scan_at(world, free_pose(world, rng)) for _ in range(40)]


def test_scan_features_of_a_full_turn_do_not_change_when_the_robot_turns():
    world, rng = office(seed=5), np.random.default_rng(1)
    for _ in range(5):
        pose = free_pose(world, rng)
        one, other = (
            scan_features(
                scan_at(world, pose + np.array([0, 0, turn]), beams=720, fov=2 * np.pi * 719 / 720)
            )
            for turn in (0.0, 1.3)
        )
        np.testing.assert_allclose(one[[0, 2]], other[[0, 2]], atol=0.02)
        np.testing.assert_allclose(one[1], other[1], atol=0.25)


def test_scan_features_hardly_depend_on_the_angular_resolution():
    world, rng = office(seed=5), np.random.default_rng(2)
    pose = free_pose(world, rng)
    coarse, fine = (scan_features(scan_at(world, pose, beams=beams)) for beams in (181, 361))
    np.testing.assert_allclose(coarse, fine, atol=0.15)


def test_invalid_beams_hardly_change_scan_features(scans):
    scan = scans[0]
    ranges = np.array(scan.ranges)
    ranges[np.random.default_rng(0).choice(len(ranges), 9, replace=False)] = np.nan
    spoiled = dataclasses.replace(scan, ranges=ranges)
    np.testing.assert_allclose(scan_features(spoiled), scan_features(scan), atol=0.15)


@pytest.mark.parametrize("fill", [np.nan, np.inf, -np.inf, 0.0, 1.0])
def test_scan_features_of_any_scan_are_finite(fill):
    scan = Scan.make(np.full(90, fill), angle_min=0.0, angle_increment=0.01, range_max=30.0)
    assert scan_features(scan.pad(128)).shape == (3,)
    assert np.all(np.isfinite(scan_features(scan)))


def test_padding_does_not_change_scan_features(scans):
    np.testing.assert_array_equal(scan_features(scans[0].pad(256)), scan_features(scans[0]))


def test_a_view_is_recognized_where_its_class_or_a_neighbour_is_registered(scans):
    config = NeuralGasConfig(neurons=20, passes=10)
    classifier = ViewClassifier.train(scans, scan_features, 0, config)
    own = classifier.classify(scans)
    for scan, class_ in zip(scans, own.tolist(), strict=True):
        neighbours = np.flatnonzero(classifier.gas.ages[class_] >= 0).tolist()
        strangers = set(own.tolist()) - {class_, *neighbours}
        assert classifier.recognizes(scan, [class_])
        assert classifier.recognizes(scan, neighbours)
        assert not classifier.recognizes(scan, strangers)
        assert not classifier.recognizes(scan, [])


def test_recognition_counts_the_own_place_and_places_far_away():
    classifier = ViewClassifier.train(
        [np.zeros(2), np.ones(2), np.array([9.0, 9.0])] * 5,
        np.asarray,
        0,
        NeuralGasConfig(neurons=3, passes=20, interval=5, oldest=5),
    )
    gas = classifier.gas
    gas.ages[:] = -1
    poses = np.array([[0.0, 0, 0], [10.0, 0, 0], [20.0, 0, 0]])
    seen = np.array([[0.5, 0, 0.1], [10.0, 0, 0], [40.0, 0, 0], [20.0, 0, 2.0]])
    result = recognition(gas, (poses, np.array([0, 1, 0])), (seen, np.array([0, 0, 0, 0])))
    assert result.mapped == 2
    assert result.here == result.here_nearest == 0.5
    assert result.far == result.far_nearest == 3 / 4  # 0: one of two; 1: both


def test_scans_of_a_second_pass_fall_into_classes_of_their_place(data):
    folder = data / "tracks" / "freiburg-079.revisit"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    runs = {
        name: (
            [entry.scan for entry in aprjax.read_log(folder / f"{name}.log.gz")],
            read_tum(folder / f"{name}.tum")[1],
        )
        for name in ("build", "track")
    }
    classifier = ViewClassifier.train(runs["build"][0], scan_features, 0)
    registered, seen = (
        (poses, classifier.classify(scans)) for scans, poses in (runs["build"], runs["track"])
    )
    result = recognition(classifier.gas, registered, seen)
    assert result.mapped == 213
    assert result.here >= 0.70
    assert result.far <= 0.30
