"""Classes of views: a feature function and the growing neural gas over its vectors."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

import numpy as np

from aprjax.places.neural_gas import NeuralGas, NeuralGasConfig

View = TypeVar("View")


@dataclass(frozen=True, eq=False)
class ViewClassifier(Generic[View]):
    """Sorts views, such as scans or images, into classes; alike ones are neighbours in the gas.

    It never says where a view was taken: a class may be seen at many places. It confirms or
    weakens what another source says.
    """

    features: Callable[[View], np.ndarray]
    """From one view to a vector `(features,)` of fixed length; `features.py` has two."""
    gas: NeuralGas

    @classmethod
    def train(
        cls,
        views: Sequence[View],
        features: Callable[[View], np.ndarray],
        seed: int,
        config: NeuralGasConfig | None = None,
    ) -> Self:
        """Classes of the views of a mapping run; the same seed gives the same classes."""
        vectors = np.stack([features(view) for view in views])
        return cls(features, NeuralGas.train(vectors, seed, config))

    def classify(self, views: Sequence[View]) -> np.ndarray:
        """The class `(views,)` of each view."""
        return self.gas.classify(np.stack([self.features(view) for view in views]))

    def recognizes(self, view: View, registered: Iterable[int]) -> bool:
        """Whether a view's class is one registered at a place, or a neighbour of one."""
        classes = np.array(list(registered), int)
        return bool(np.any(self.gas.alike(self.classify([view])[0], classes)))
