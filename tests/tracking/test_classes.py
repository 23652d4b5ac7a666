import numpy as np
import pytest

import aprjax.tracking.classes
from aprjax.places.classifier import ViewClassifier
from aprjax.places.neural_gas import NeuralGas, NeuralGasConfig
from aprjax.tracking.classes import (
    ClassConfig,
    ClassSource,
    image_source,
    register_images,
    scan_source,
)
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place, WorldModelError
from aprjax.world.store import load_map, save_map
from tests.tracking.worlds import at, corridor, drive, sure, tracker
from tests.worlds import office, scan_at

CONFIG = ClassConfig()


def brightness(view):
    """Features of a view that is its brightness: class k is a view of brightness k."""
    return np.array([float(view)])


def classifier(classes=6, neighbours=((0, 1),)):
    gas = NeuralGas.start(np.zeros(1), np.ones(1), NeuralGasConfig(neurons=classes))
    gas.weights[:, 0], gas.alive[:] = np.arange(classes), True
    for a, b in neighbours:
        gas.ages[a, b] = gas.ages[b, a] = 0
    return ViewClassifier(brightness, gas)


def source(*registered, **config):
    """Classes registered at (node, x), in the corridor's nodes."""
    places = [(Place(node, np.array([x, 0.0, 0.0])), number) for node, x, number in registered]
    return ClassSource(classifier(), places, "image", ClassConfig(**config))


EVERYWHERE = [(0, 0.0, 0), (1, 0.0, 2), (2, 0.0, 3), (2, 2.0, 4), (2, 4.0, 5)]


def verdict(made, view, x=0.0, node=0):
    world = corridor()
    (found,) = made.judge(view, sure(world=world, node=node, x=x).hypotheses, world)
    return found


def test_a_view_of_a_class_of_the_place_confirms_and_one_of_another_place_weakens():
    made = source(*EVERYWHERE)
    assert verdict(made, 0).likelihood > 2
    assert verdict(made, 3).likelihood == pytest.approx(1 - CONFIG.same - CONFIG.near)
    assert verdict(made, 0).place is None


def test_a_neighbouring_class_confirms_less_than_the_same():
    made = source(*EVERYWHERE)
    assert verdict(made, 3).likelihood < verdict(made, 1).likelihood < verdict(made, 0).likelihood


def test_a_class_that_is_registered_everywhere_says_little():
    common = source(*[(node, x, 0) for node, x, _ in EVERYWHERE])
    assert verdict(common, 0).likelihood == pytest.approx(
        CONFIG.same + 1 - CONFIG.same - CONFIG.near
    )


def test_the_ratio_is_bounded():
    assert verdict(source(*EVERYWHERE, most=1.5), 0).likelihood == pytest.approx(1.5)


def test_where_nothing_is_registered_nothing_is_said():
    assert verdict(source((2, 3.0, 0)), 0).likelihood == 1
    assert verdict(source(), 0).likelihood == 1


def test_views_turned_away_are_not_those_of_a_hypothesis():
    place = Place(0, np.array([0.0, 0.0, np.pi]))
    assert verdict(ClassSource(classifier(), [(place, 0)], "image"), 0).likelihood == 1


def test_classes_keep_a_hypothesis_alive_that_nothing_else_confirms():
    places = [(Place(0, np.array([float(x), 0.0, 0.0])), x) for x in range(18)]
    own = classifier(classes=18, neighbours=())
    left = []
    for validation in ([ClassSource(own, places, "image")], []):
        made = sure(validation=validation)
        for x in range(1, 13):
            made.move(step=drive(1.0))
            made.observe(estimates=[], image=x)
        left.append(made.belief.best.probability if made.belief.best else 0.0)
    assert left[0] > 0.5 > left[1]


def test_images_are_registered_where_their_scans_were_taken_and_saved_with_the_map(tmp_path):
    world = corridor()
    for node in (0, 2):
        world.place_scan(10 + node, Place(node, np.array([0.5, 0.0, 0.0])))
    register_images(world, classifier(), {10: 3, 12: 4, 99: 5})
    assert [seen.image_class for seen in world.images.values()] == [3, 4]
    assert [seen.place.node for seen in world.images.values()] == [0, 2]
    save_map(world, tmp_path / "corridor.map")
    loaded = load_map(tmp_path / "corridor.map")
    for known in (world, loaded):
        hypotheses = sure(world=known, node=0, x=0.5).hypotheses
        made = image_source(known, classifier())
        assert made.judge(3, hypotheses, known)[0].likelihood > 1
        assert made.judge(5, hypotheses, known)[0].likelihood < 1


def test_the_classes_of_the_references_need_no_training_run():
    plan, world = office(seed=3), corridor()
    poses = [np.array([2.0, 2.0, 0.3]), np.array([9.0, 7.0, 2.0]), np.array([14.0, 0.0, 0.0])]
    places = [world.appearances[number] for number in (0, 1, 2)]
    world.remove_references([0, 1, 2])
    world.add_references([scan_at(plan, pose) for pose in poses], places)
    made = scan_source(world)
    assert made.reads == "scan"
    here, elsewhere = (
        made.judge(scan_at(plan, pose), sure(world=world).hypotheses, world)[0].likelihood
        for pose in poses[:2]
    )
    assert here > 1 > elsewhere


def test_a_model_without_references_has_no_classes_of_scans():
    for made in (None, classifier()):
        with pytest.raises(WorldModelError, match="references: the world model has none"):
            scan_source(WorldModel(), made)


def test_another_world_is_asked_about_itself():
    made, near, apart = source((0, 4.0, 0)), corridor(), corridor()
    apart.remove_arc(0, 1)
    hypotheses = sure(world=near, node=1).hypotheses
    asked = [made.judge(0, hypotheses, world)[0].likelihood for world in (near, apart, near)]
    assert asked[0] == asked[2] != 1
    assert asked[1] == 1


def test_how_common_a_class_is_is_asked_of_all_registered_places_at_once(monkeypatch):
    calls, distance = [], aprjax.tracking.classes.distance

    def counted(T):
        calls.append(len(T))
        return distance(T)

    monkeypatch.setattr(aprjax.tracking.classes, "distance", counted)
    rng = np.random.default_rng(0)
    xs, classes = rng.uniform(-2, 2, 150), rng.integers(0, 6, 150)
    made = source(*((k % 3, x, int(c)) for k, (x, c) in enumerate(zip(xs, classes, strict=True))))
    world = corridor()
    hypotheses = [sure(world=world, node=node).hypotheses[0] for node in (0, 1, 2)]
    verdicts = made.judge(0, hypotheses, world)
    assert len(calls) <= 1 + len(hypotheses)
    # One place after the other: x along the corridor, all looking ahead.
    x = xs + 4.0 * (np.arange(150) % 3)
    for node, (hypothesis, found) in enumerate(zip(hypotheses, verdicts, strict=True)):
        reach = float(CONFIG.reach) + hypothesis.radius
        likeness = np.where(classes == 0, 2, np.where(classes == 1, 1, 0))
        around = [likeness[np.abs(x - at) <= reach].max() for at in x]
        best = likeness[np.abs(x - 4.0 * node) <= reach].max()
        share = {2: float(CONFIG.same), 1: float(CONFIG.near)}[int(best)]
        expected = share / np.mean(np.array(around) == best) + 1 - CONFIG.same - CONFIG.near
        assert found.likelihood == pytest.approx(float(expected))


def test_every_hypothesis_gets_a_verdict_and_the_tracker_uses_them():
    made = tracker(validation=[source(*EVERYWHERE)])
    made.observe(estimates=[at(0), at(2)])
    first, second = (h.probability for h in made.hypotheses)
    assert first == pytest.approx(second)
    made.move(step=drive(0.0, 0.0, 0.0))
    made.observe(image=0)
    assert made.belief.best.place.node == 0
