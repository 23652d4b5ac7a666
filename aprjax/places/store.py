"""Classifiers as files: the growing neural gas, in one compressed NumPy archive.

The feature function is code and not in the file, but its name is: a gas of other features would
sort every view into some class.
"""

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.io.archive import Archive, ArchiveError, read_archive
from aprjax.places.classifier import ViewClassifier
from aprjax.places.neural_gas import NeuralGas, NeuralGasConfig

FORMAT = "aprjax classifier"
VERSION = 1


class ClassifierFileError(ValueError):
    """A classifier file that cannot be used. One line: the path and why."""


def save_classifier(classifier: ViewClassifier, path: str | os.PathLike[str]) -> None:
    """Write a classifier to exactly `path`, completely or not at all (see `atomic_write`)."""
    gas = classifier.gas
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.int64(VERSION),
        "features": np.array(classifier.features.__name__),
        "config": np.array(json.dumps(dataclasses.asdict(gas.config))),
        "weights": np.asarray(gas.weights, np.float64),
        "alive": np.asarray(gas.alive, bool),
        "errors": np.asarray(gas.errors, np.float64),
        "ages": np.asarray(gas.ages, np.int64),
        "signals": np.int64(gas.signals),
    }
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def load_classifier(
    path: str | os.PathLike[str], features: Callable[[Any], np.ndarray]
) -> ViewClassifier:
    """The classifier that `save_classifier` wrote; it sorts views to the bit as before.

    `features` is the function that it was trained with. Raises `ClassifierFileError` for another
    one, and for a file that cannot be read, is cut off, damaged, of another kind or of a newer
    version, or whose contents no growing neural gas can have.
    """
    try:
        arrays = read_archive(Path(path), "classifier file")
        arrays.check_format(FORMAT, VERSION)
        name = str(arrays.get("features", (), "U"))
        if name != features.__name__:
            raise ArchiveError(f"its features are {name}, not {features.__name__}")
        return ViewClassifier(features, _gas(arrays))
    except ArchiveError as error:
        raise ClassifierFileError(f"{os.fspath(path)}: {error}") from None


def _gas(arrays: Archive) -> NeuralGas:
    config = _config(str(arrays.get("config", (), "U")))
    size = config.neurons
    gas = NeuralGas(
        config=config,
        weights=arrays.get("weights", (size, None), np.float64),
        alive=arrays.get("alive", (size,), np.bool_),
        errors=arrays.get("errors", (size,), np.float64),
        ages=arrays.get("ages", (size, size), np.int64),
        signals=int(arrays.get("signals", (), np.int64)),
    )
    edge = gas.ages >= 0
    for holds, message in (
        (np.all(np.isfinite(gas.weights)), "weights: a number is not finite"),
        (np.all(gas.errors >= 0) and np.all(np.isfinite(gas.errors)), "errors: one is negative"),
        (gas.alive.sum() >= 2, "alive: there are fewer than two neurons"),
        (np.array_equal(gas.ages, gas.ages.T), "ages: they are not symmetric"),
        (not edge[~gas.alive].any(), "ages: a neuron that there is not has an edge"),
        (not np.diag(edge).any(), "ages: a neuron has an edge to itself"),
        (gas.signals >= 0, f"signals: {gas.signals} is negative"),
    ):
        if not holds:
            raise ArchiveError(message)
    return gas


def _config(text: str) -> NeuralGasConfig:
    try:
        return NeuralGasConfig(**json.loads(text))
    except (TypeError, ValueError, RecursionError) as error:
        raise ArchiveError(f"config is none of a growing neural gas: {error}") from None
