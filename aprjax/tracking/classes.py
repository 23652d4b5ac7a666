"""Classes of views as validation source: does the place look as it did in the mapping run?

The classes of the mapping run's views are registered where they were taken; growing neural gas
(`aprjax.places`) sorted them. A class may be seen at many places, so that it finds none; but it
confirms or weakens what is believed, also where a scanner sees nothing to match.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import scan_features
from aprjax.plane import distance
from aprjax.tracking.hypothesis import Hypothesis
from aprjax.tracking.neighbours import Neighbours, Surroundings
from aprjax.tracking.sources import Verdict
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Place

_PROBES = 200  # registered views at most that say how common a class is
_FARTHEST = 30.0  # metres along arcs to nodes whose views are compared with a volume


class ClassConfig(eqx.Module):
    """How classes of views count.

    The model: with the probability `same` a view has a class of its place, with the probability
    `near` a class beside one in the gas; otherwise it has any class, as often as that is registered
    anywhere. That leaves enough for places that have changed.
    """

    same: Float[Array, ""] = threshold(0.6, "share of views of a class registered at their place")
    near: Float[Array, ""] = threshold(0.2, "share of views of a neighbouring class only")
    most: Float[Array, ""] = threshold(20.0, "largest likelihood ratio of one view")
    reach: Float[Array, ""] = threshold(0.6, "metres beyond a volume to views that show the same")
    turn: Float[Array, ""] = threshold(np.radians(30), "radians beyond it")


class ClassSource:
    """Asks whether a view is of a class that is registered where a hypothesis has the robot.

    For how common a class is, the registered places themselves are asked, with the same volume
    around each: a class seen everywhere confirms nothing. Where nothing is registered, nothing is
    said.
    """

    def __init__(
        self,
        classifier: ViewClassifier,
        registered: Sequence[tuple[Place, int]],
        reads: str,
        config: ClassConfig | None = None,
    ) -> None:
        """`registered` are places and the classes of what was seen there; see `image_source`."""
        self.reads = reads
        self.config = ClassConfig() if config is None else config
        self._classifier = classifier
        self._places = [place for place, _ in registered]
        self._classes = np.array([number for _, number in registered], int)
        self._views: Surroundings | None = None
        self._probes: list[tuple[np.ndarray, np.ndarray]] = []

    def judge(
        self, reading: Any, hypotheses: Sequence[Hypothesis], world: WorldModel
    ) -> Sequence[Verdict]:
        """Verdicts on all hypotheses; a reading is one view, such as the classifier takes."""
        if self._views is None:
            self._views = Surroundings(Neighbours(world, _FARTHEST), dict(enumerate(self._places)))
            spread_out = np.linspace(0, len(self._places) - 1, min(_PROBES, len(self._places)))
            self._probes = [self._views.around(self._places[row]) for row in spread_out.astype(int)]
        seen = np.array(int(self._classifier.classify([reading])[0]))
        likeness = np.where(
            self._classes == seen, 2, self._classifier.gas.alike(seen, self._classes).astype(int)
        )
        return [Verdict(self._ratio(likeness, h, self._views)) for h in hypotheses]

    def _ratio(self, likeness: np.ndarray, hypothesis: Hypothesis, views: Surroundings) -> float:
        """The likelihood ratio of a view.

        `likeness` `(registered,)` is 2 for registered views of the same class, 1 for those of a
        neighbouring one, else 0.
        """
        here = self._within(*views.around(hypothesis.place), hypothesis)
        if not len(here):
            return 1.0
        same, near = float(self.config.same), float(self.config.near)
        best = int(likeness[here].max())
        if best == 0:
            return 1.0 - same - near
        found = [likeness[self._within(*probe, hypothesis)].max() for probe in self._probes]
        common = max(float(np.mean(np.array(found) == best)), 1e-3)
        ratio = (same if best == 2 else near) / common + 1.0 - same - near
        return min(ratio, float(self.config.most))

    def _within(
        self, numbers: np.ndarray, T_view_place: np.ndarray, hypothesis: Hypothesis
    ) -> np.ndarray:
        """Numbers of the views that lie in a volume as large as the hypothesis' about a place."""
        near = distance(T_view_place) <= float(self.config.reach) + hypothesis.radius
        turned = np.abs(T_view_place[:, 2]) <= float(self.config.turn) + hypothesis.angle
        return numbers[near & turned]


def register_images(
    world: WorldModel, classifier: ViewClassifier, images: Mapping[int, np.ndarray]
) -> None:
    """Register the classes of a mapping run's images at the arcs' ends, where they were taken.

    `images` by the number of the scan in the log that was taken with each. Those whose scan has no
    place in the world model are left out. `save_map` writes them with it.
    """
    placed = [scan for scan in sorted(images) if scan in world.places]
    if placed:
        classes = classifier.classify([images[scan] for scan in placed])
        for scan, image_class in zip(placed, classes.tolist(), strict=True):
            world.add_image(Appearance(world.places[scan], scan, image_class))


def image_source(
    world: WorldModel, classifier: ViewClassifier, config: ClassConfig | None = None
) -> ClassSource:
    """The classes of the images registered in a world model; a reading is an `image`."""
    registered = [
        (seen.place, seen.image_class)
        for _, seen in sorted(world.images.items())
        if seen.image_class is not None
    ]
    return ClassSource(classifier, registered, "image", config)


def scan_source(
    world: WorldModel,
    classifier: ViewClassifier | None = None,
    config: ClassConfig | None = None,
    seed: int = 0,
) -> ClassSource:
    """The classes of the reference scans, which the map holds anyway; a reading is a `scan`.

    Without a `classifier`, one is trained on the same scans. Raises `WorldModelError` or
    `ValueError` for fewer than two.
    """
    scans = [scan for _, scan in sorted(world.reference_scans.items())]
    if classifier is None:
        classifier = ViewClassifier.train(scans, scan_features, seed)
    places = [seen.place for _, seen in sorted(world.appearances.items())]
    classes = classifier.classify(scans).tolist()
    return ClassSource(classifier, list(zip(places, classes, strict=True)), "scan", config)
