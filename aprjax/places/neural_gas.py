"""Growing neural gas: classes of views, and which of them are alike.

Fritzke, A Growing Neural Gas Network Learns Topologies, NIPS 7, 1995; the steps below bear the
numbers they have there. The neurons are the classes; an edge of the graph says that two are
neighbours, for some training signal had them as its nearest and second nearest.
"""

from dataclasses import dataclass

import numpy as np

_NO_EDGE = -1


@dataclass(frozen=True)
class NeuralGasConfig:
    """Fritzke's parameters, with his names in the words; the defaults suit a few hundred views."""

    neurons: int = 150
    """Capacity: once there are so many, none is inserted before one is removed."""
    nearest_rate: float = 0.1
    """ε_b: share of the way to a signal that its nearest neuron goes."""
    neighbour_rate: float = 0.006
    """ε_n: likewise the nearest one's neighbours."""
    oldest: int = 200
    """a_max: signals of a neuron without its neighbour that an edge outlives."""
    interval: int = 50
    """λ: signals from one insertion to the next."""
    split_decay: float = 0.5
    """α: what is left of the errors of the two neurons that a new one is put between."""
    decay: float = 0.995
    """d: what is left of every error after each signal."""
    passes: int = 40
    """How often the training views are shown."""

    def __post_init__(self) -> None:
        for name, holds, condition in (
            ("neurons", self.neurons >= 2, "at least 2"),
            ("nearest_rate", 0 < self.nearest_rate <= 1, "in (0, 1]"),
            ("neighbour_rate", 0 <= self.neighbour_rate <= 1, "in [0, 1]"),
            ("oldest", self.oldest >= 1, "at least 1"),
            ("interval", self.interval >= 1, "at least 1"),
            ("split_decay", 0 <= self.split_decay <= 1, "in [0, 1]"),
            ("decay", 0 <= self.decay <= 1, "in [0, 1]"),
            ("passes", self.passes >= 1, "at least 1"),
        ):
            if not holds:
                raise ValueError(f"{name}: {getattr(self, name)} is not {condition}")


@dataclass(eq=False)
class NeuralGas:
    """The neurons and their graph. `show` changes it in place; `classify` never does."""

    config: NeuralGasConfig
    weights: np.ndarray
    """`(neurons, features)`: the view that each neuron stands for; zero where there is none."""
    alive: np.ndarray
    """`(neurons,)`."""
    errors: np.ndarray
    """`(neurons,)`: accumulated square distances."""
    ages: np.ndarray
    """`(neurons, neurons)`, symmetric: the age of each edge, -1 where there is none."""
    signals: int = 0
    """How many were shown."""

    @classmethod
    def start(cls, first: np.ndarray, second: np.ndarray, config: NeuralGasConfig) -> "NeuralGas":
        """Step 0: two neurons without an edge, at two vectors `(features,)`."""
        capacity = config.neurons
        gas = cls(
            config=config,
            weights=np.zeros((capacity, len(first))),
            alive=np.zeros(capacity, bool),
            errors=np.zeros(capacity),
            ages=np.full((capacity, capacity), _NO_EDGE),
        )
        gas.weights[:2], gas.alive[:2] = (first, second), True
        return gas

    @classmethod
    def train(
        cls, features: np.ndarray, seed: int, config: NeuralGasConfig | None = None
    ) -> "NeuralGas":
        """The gas of views `features` `(views, features)`, shown in a random order each pass.

        The same seed gives the same bits. Raises `ValueError` for fewer than two views and naming
        the index of a number that is not finite.
        """
        config = NeuralGasConfig() if config is None else config
        features = _checked("features", features)
        if len(features) < 2:
            raise ValueError(f"features: {len(features)} views are fewer than two")
        rng = np.random.default_rng(seed)
        first, second = features[rng.choice(len(features), 2, replace=False)]
        gas = cls.start(first, second, config)
        for _ in range(config.passes):
            for index in rng.permutation(len(features)):
                gas.show(features[index])
        return gas

    def show(self, signal: np.ndarray) -> None:
        """Adapt to one signal `(features,)`."""
        config, ages = self.config, self.ages
        square = self._square_distances(signal)
        nearest, second = (int(k) for k in np.argsort(square, kind="stable")[:2])  # 2
        around = ages[nearest] >= 0
        ages[nearest, around] += 1  # 3
        ages[around, nearest] += 1
        self.errors[nearest] += square[nearest]  # 4
        self.weights[nearest] += config.nearest_rate * (signal - self.weights[nearest])  # 5
        self.weights[around] += config.neighbour_rate * (signal - self.weights[around])
        ages[nearest, second] = ages[second, nearest] = 0  # 6
        expired = ages[nearest] > config.oldest  # 7: only edges of the nearest one aged
        if expired.any():
            ages[nearest, expired] = ages[expired, nearest] = _NO_EDGE
            self._remove_isolated()
        self.signals += 1
        if self.signals % config.interval == 0:
            self._insert()
        self.errors *= config.decay  # 9

    def classify(self, features: np.ndarray) -> np.ndarray:
        """The class `(views,)` of each of the views `(views, features)`: its nearest neuron."""
        features = _checked("features", features, self.weights.shape[1])
        return np.array([int(np.argmin(self._square_distances(row))) for row in features], int)

    def alike(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Which classes are the same or neighbours; arrays of class numbers that broadcast."""
        return (one == other) | (self.ages[one, other] >= 0)

    @property
    def edges(self) -> np.ndarray:
        """Pairs `(edges, 2)` of neighbouring classes, the lower number first."""
        return np.argwhere(np.triu(self.ages >= 0))

    def _square_distances(self, signal: np.ndarray) -> np.ndarray:
        square = ((self.weights - signal) ** 2).sum(axis=1)
        square[~self.alive] = np.inf
        return square

    def _remove_isolated(self) -> None:
        """Step 7: neurons without an edge go, but never the last two."""
        isolated = np.flatnonzero(self.alive & ~(self.ages >= 0).any(axis=1))
        for index in isolated[: max(int(self.alive.sum()) - 2, 0)]:
            self.alive[index], self.weights[index], self.errors[index] = False, 0.0, 0.0

    def _insert(self) -> None:
        """Step 8: a neuron between the one of the largest error and its worst neighbour."""
        free = np.flatnonzero(~self.alive)
        if not len(free):
            return
        worst = int(np.argmax(np.where(self.alive, self.errors, -1.0)))
        around = self.ages[worst] >= 0
        if not around.any():
            return
        beside = int(np.argmax(np.where(around, self.errors, -1.0)))
        new = int(free[0])
        self.alive[new] = True
        self.weights[new] = (self.weights[worst] + self.weights[beside]) / 2
        self.ages[worst, beside] = self.ages[beside, worst] = _NO_EDGE
        for end in (worst, beside):
            self.ages[end, new] = self.ages[new, end] = 0
            self.errors[end] *= self.config.split_decay
        self.errors[new] = self.errors[worst]


def _checked(name: str, values: np.ndarray, length: int | None = None) -> np.ndarray:
    """Features `(views, length)` in double precision.

    Raises `ValueError` naming the field for another shape, and the index of a number that is not
    finite.
    """
    array = np.asarray(values, float)
    if array.ndim != 2 or (length is not None and array.shape[1] != length):
        raise ValueError(f"{name}: shape {array.shape} is not (views, {length or 'features'})")
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        index = ", ".join(map(str, wrong[0]))
        raise ValueError(f"{name}[{index}]: {array[tuple(wrong[0])]} is not finite")
    return array
