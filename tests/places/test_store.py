import json

import numpy as np
import pytest

from aprjax.places.classifier import ViewClassifier
from aprjax.places.neural_gas import NeuralGasConfig
from aprjax.places.store import ClassifierFileError, load_classifier, save_classifier


def whole(view):
    return np.asarray(view, float)


@pytest.fixture
def trained():
    views = list(np.random.default_rng(0).normal(size=(60, 3)))
    return ViewClassifier.train(views, whole, 1, NeuralGasConfig(neurons=12, passes=20)), views


def test_a_loaded_classifier_sorts_views_as_before_and_grows_on_the_same(trained, tmp_path):
    classifier, views = trained
    save_classifier(classifier, tmp_path / "views.classes")
    loaded = load_classifier(tmp_path / "views.classes", whole)
    np.testing.assert_array_equal(loaded.classify(views), classifier.classify(views))
    np.testing.assert_array_equal(loaded.gas.edges, classifier.gas.edges)
    assert loaded.gas.config == classifier.gas.config
    for view in views:
        loaded.gas.show(view)
        classifier.gas.show(view)
    np.testing.assert_array_equal(loaded.gas.weights, classifier.gas.weights)


def test_other_features_are_refused_by_name(trained, tmp_path):
    save_classifier(trained[0], tmp_path / "views.classes")
    with pytest.raises(ClassifierFileError, match="whole, not brightness"):
        load_classifier(tmp_path / "views.classes", brightness)


def brightness(view):
    return np.array([np.mean(view)])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"weights": np.full((12, 3), np.nan)}, "not finite"),
        ({"weights": np.zeros((5, 3))}, "shape"),
        ({"ages": np.triu(np.ones((12, 12), int))}, "symmetric"),
        ({"ages": np.zeros((12, 12), int)}, "edge"),
        ({"alive": np.zeros(12, bool)}, "fewer than two"),
        ({"errors": np.full(12, -1.0)}, "negative"),
        ({"signals": np.int64(-1)}, "negative"),
        ({"config": np.array("[1]")}, "config"),
        ({"config": np.array(json.dumps({"neurons": 1}))}, "at least 2"),
        ({"format": np.array("aprjax map")}, "not a classifier file"),
        ({"version": np.int64(9)}, "newer"),
    ],
)
def test_contents_that_no_gas_can_have_are_refused(trained, tmp_path, change, text):
    path = tmp_path / "views.classes"
    save_classifier(trained[0], path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    with path.open("wb") as out:
        np.savez_compressed(out, **{**arrays, **change})
    with pytest.raises(ClassifierFileError, match=text) as refused:
        load_classifier(path, whole)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"PK nonsense", b"text"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "views.classes").write_bytes(content)
    with pytest.raises(ClassifierFileError):
        load_classifier(tmp_path / "views.classes", whole)
