import numpy as np
import pytest

from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import image_features
from aprjax.places.recognition import recognition
from aprjax.sim.camera import Camera, take_images
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import office
from aprjax.sim.textures import Textures


@pytest.fixture
def image():
    return np.random.default_rng(0).integers(20, 200, (16, 64, 3)).astype(np.uint8)


def test_brightness_and_colour_of_the_light_do_not_matter(image):
    lit = image * np.array([0.9, 0.5, 0.7])
    np.testing.assert_allclose(image_features(lit), image_features(image), atol=1e-9)


def test_bytes_and_shares_give_the_same_features(image):
    np.testing.assert_allclose(image_features(image / 255), image_features(image), atol=1e-9)


def test_the_histogram_does_not_know_where_colours_are_and_the_parts_do(image):
    image[:, :16, 0] //= 4
    shifted = np.roll(image, 16, axis=1)
    one, other = image_features(image), image_features(shifted)
    np.testing.assert_allclose(one[:16], other[:16], atol=1e-9)
    np.testing.assert_allclose(np.roll(one[16:].reshape(4, 3), 1, axis=0), other[16:].reshape(4, 3))
    assert np.abs(one[16:] - other[16:]).max() > 0.3


@pytest.mark.parametrize("fill", [0, 1, 255])
def test_an_image_of_one_colour_has_finite_features(fill):
    features = image_features(np.full((3, 4, 3), fill, np.uint8))
    assert features.shape == (28,)
    assert np.all(np.isfinite(features))
    np.testing.assert_allclose((features[:16] ** 2).sum(), 1.0)


@pytest.mark.parametrize(
    "image",
    [np.zeros((4, 4)), np.zeros((4, 3, 3)), np.zeros((0, 4, 3)), np.full((2, 4, 3), np.nan)],
)
def test_what_is_no_image_is_refused(image):
    with pytest.raises(ValueError, match="image: "):
        image_features(image)


def test_images_of_a_second_drive_fall_into_classes_of_their_place():
    plan = office(1)
    later = plan.rearranged(5, 0.25)
    textures = Textures.draw(2, plan)
    first, second = drive(3, plan, 600, 0.5)[0], drive(4, later, 300, 1.0)[0]
    mapping = list(take_images(5, Camera(), plan, textures, first))
    images = list(take_images(6, Camera(), later, textures, second))
    classifier = ViewClassifier.train(mapping, image_features, 0)
    result = recognition(
        classifier.gas,
        (first, classifier.classify(mapping)),
        (second, classifier.classify(images)),
    )
    assert result.mapped > 200
    assert result.here_nearest >= 0.8
    assert result.far <= 0.2
