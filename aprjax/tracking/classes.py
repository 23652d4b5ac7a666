"""Classes of views as validation source: does the place look as it did in the mapping run?

The classes of the mapping run's views are registered where they were taken; growing neural gas
(`aprjax.places`) sorted them. A class may be seen at many places, so that it finds none; but it
confirms or weakens what is believed, also where a scanner sees nothing to match.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from aprjax.world.parts import Appearance, Place, WorldModelError

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
        self._seen: _Seen | None = None

    def judge(
        self, reading: Any, hypotheses: Sequence[Hypothesis], world: WorldModel
    ) -> Sequence[Verdict]:
        """Verdicts on all hypotheses; a reading is one view, such as the classifier takes."""
        if self._seen is None or self._seen.world is not world:
            self._seen = _Seen.of(world, self._places)
        number = np.array(int(self._classifier.classify([reading])[0]))
        likeness = np.where(
            self._classes == number,
            2,
            self._classifier.gas.alike(number, self._classes).astype(int),
        )
        at_probes = likeness[self._seen.numbers]
        return [Verdict(self._ratio(likeness, at_probes, h, self._seen)) for h in hypotheses]

    def _ratio(
        self, likeness: np.ndarray, at_probes: np.ndarray, hypothesis: Hypothesis, seen: "_Seen"
    ) -> float:
        """The likelihood ratio of a view.

        `likeness` `(registered,)` is 2 for registered views of the same class, 1 for those of a
        neighbouring one, else 0; `at_probes` is that of the views around the probes.
        """
        numbers, T_view_place = seen.views.around(hypothesis.place)
        here = numbers[self._within(*_offs(T_view_place), hypothesis)]
        if not len(here):
            return 1.0
        same, near = float(self.config.same), float(self.config.near)
        best = int(likeness[here].max())
        if best == 0:
            return 1.0 - same - near
        inside = self._within(seen.metres, seen.radians, hypothesis)
        found = np.maximum.reduceat(inside * at_probes, seen.starts)
        common = max(float(np.mean(found == best)), 1e-3)
        ratio = (same if best == 2 else near) / common + 1.0 - same - near
        return min(ratio, float(self.config.most))

    def _within(
        self, metres: np.ndarray, radians: np.ndarray, hypothesis: Hypothesis
    ) -> np.ndarray:
        """Which views `(n,)` so far off a place lie in a volume as large as the hypothesis'."""
        near = metres <= float(self.config.reach) + hypothesis.radius
        return near & (radians <= float(self.config.turn) + hypothesis.angle)


@dataclass(frozen=True, eq=False)
class _Seen:
    """The registered views in one world model, and those around the probes among them."""

    world: WorldModel
    views: Surroundings
    numbers: np.ndarray
    """`(n,)` of the views around the probes, probe after probe."""
    metres: np.ndarray
    """`(n,)` between each of them and its probe."""
    radians: np.ndarray
    """`(n,)`, likewise; not negative."""
    starts: np.ndarray
    """`(probes,)`: where each probe's views begin; itself is always among them."""

    @classmethod
    def of(cls, world: WorldModel, places: Sequence[Place]) -> "_Seen":
        """With the probes spread evenly over the registered `places`."""
        views = Surroundings(Neighbours(world, _FARTHEST), dict(enumerate(places)))
        probes = np.linspace(0, len(places) - 1, min(_PROBES, len(places))).astype(int)
        around = [views.around(places[probe]) for probe in probes]
        counts = np.array([len(numbers) for numbers, _ in around], int)
        numbers = np.concatenate([np.zeros(0, int), *(numbers for numbers, _ in around)])
        T_view_probe = np.concatenate([np.zeros((0, 3)), *(T for _, T in around)])
        return cls(world, views, numbers, *_offs(T_view_probe), np.cumsum(counts) - counts)


def _offs(T_view_place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres and radians `(n,)` of poses `(n, 3)`."""
    return distance(T_view_place), np.abs(T_view_place[:, 2])


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

    Without a `classifier`, one is trained on the same scans. Raises `WorldModelError` if there are
    none, and `ValueError` for one scan that is to be trained on.
    """
    scans = [scan for _, scan in sorted(world.reference_scans.items())]
    if not scans:
        raise WorldModelError("references: the world model has none to make classes of")
    if classifier is None:
        classifier = ViewClassifier.train(scans, scan_features, seed)
    places = [seen.place for _, seen in sorted(world.appearances.items())]
    classes = classifier.classify(scans).tolist()
    return ClassSource(classifier, list(zip(places, classes, strict=True)), "scan", config)
