"""Thresholds by dotted name, and all combinations of their values."""

import difflib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig

FEATURES = "features."
"""What names of thresholds begin with that belong to the description of scans."""

_Config = TypeVar("_Config", bound=eqx.Module)


def thresholds(config: eqx.Module, prefix: str = "") -> dict[str, Any]:
    """All that can be swept, by dotted name, with the configuration's values."""
    found = {}
    for field in fields(config):
        value, name = getattr(config, field.name), prefix + field.name
        if isinstance(value, eqx.Module):
            found |= thresholds(value, f"{name}.")
        elif isinstance(value, np.ndarray | jax.Array):
            found[name] = value
    return found


def product(axes: Mapping[str, Sequence[float] | np.ndarray]) -> dict[str, np.ndarray]:
    """All combinations of values: columns `(configurations,)`, those of the last axis fastest.

    Raises `ValueError` for no axis, for one without values, or with one that is not finite.
    """
    if not axes:
        raise ValueError("axes: there is none")
    for name, values in axes.items():
        if np.ndim(values) != 1 or not np.size(values) or not np.all(np.isfinite(values)):
            raise ValueError(f"{name}: {values!r} are no finite values along an axis")
    rows = itertools.product(*(np.asarray(values, np.float32) for values in axes.values()))
    table = np.array(list(rows), np.float32)
    return {name: table[:, k] for k, name in enumerate(axes)}


def configured(config: _Config, values: Mapping[str, Any]) -> _Config:
    """The configuration with other thresholds, each of dotted name a number or `(n,)` of them.

    Raises `ValueError` for a name that is no threshold, and for a value out of its range.
    """
    for name, value in values.items():
        _check_name(config, name)
        path = name.split(".")
        try:
            config = _with(config, path, value)
        except ValueError as error:  # it names the last part alone, which other stages may have too
            raise ValueError(f"{name}{str(error).removeprefix(path[-1])}") from None
    return config


def check_names(names: Iterable[str]) -> None:
    """Raise `ValueError` for a name that no threshold of `MatchConfig` and `FeatureConfig` has."""
    for name in names:
        if name.startswith(FEATURES):
            _check_name(FeatureConfig(), name.removeprefix(FEATURES), FEATURES)
        else:
            _check_name(MatchConfig(), name)


def check_values(name: str, values: np.ndarray) -> None:
    """Raise `ValueError` naming the first of `values` `(any,)` that the threshold cannot have."""
    own = name.removeprefix(FEATURES)
    try:
        configured(MatchConfig() if own == name else FeatureConfig(), {own: values})
    except ValueError as error:
        raise ValueError(f"{name.removesuffix(own)}{error}") from None


def _check_name(config: eqx.Module, name: str, prefix: str = "") -> None:
    """Raise `ValueError` unless this is the name of a threshold; tell why, or what is like it."""
    known = thresholds(config)
    if name in known:
        return
    part: Any = config
    for word in name.split("."):
        if not isinstance(part, eqx.Module) or word not in {field.name for field in fields(part)}:
            break
        part = getattr(part, word)
    else:
        if isinstance(part, eqx.Module):
            raise ValueError(f"{prefix}{name}: is a stage, with {', '.join(thresholds(part))}")
        raise ValueError(
            f"{prefix}{name}: is a capacity, which sets array sizes and cannot be swept"
        )
    last = {full.split(".")[-1]: full for full in known}
    near = difflib.get_close_matches(name, known, n=3) or [
        last[word] for word in difflib.get_close_matches(name.split(".")[-1], last, n=3)
    ]
    like = f"; near it: {', '.join(prefix + full for full in near)}" if near else ""
    raise ValueError(f"{prefix}{name}: there is no such threshold{like}")


def _with(config: Any, path: list[str], value: Any) -> Any:
    head, *rest = path
    return replace(config, **{head: _with(getattr(config, head), rest, value) if rest else value})
