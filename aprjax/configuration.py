"""Fields of configurations, and configurations as plain dictionaries.

A configuration is an equinox module. Thresholds are array leaves, so that a new value never
retraces and a sweep is a `vmap`; capacities set array sizes and are static.
"""

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

_Config = TypeVar("_Config", bound=eqx.Module)


def threshold(default: float, doc: str) -> Any:
    """A field that is a float32 array leaf.

    NumPy holds the value, so that building a configuration touches no device.
    """

    def convert(value: Any) -> Any:
        # A weakly typed array would trace anew, so JAX's arrays are pinned too.
        if isinstance(value, jax.Array):
            return jax.lax.convert_element_type(value, np.float32)
        return np.asarray(value, np.float32)

    return eqx.field(default=default, converter=convert, metadata={"doc": doc})


def capacity(default: int | None, doc: str) -> Any:
    """A field that sets an array size: static, so a new value compiles anew."""
    return eqx.field(default=default, static=True, metadata={"doc": doc})


def to_dict(config: eqx.Module) -> dict[str, Any]:
    """Names and values, nested as the configuration is, of plain Python numbers."""

    def plain(value: Any) -> Any:
        if isinstance(value, eqx.Module):
            return to_dict(value)
        return value if value is None or isinstance(value, int) else np.asarray(value).tolist()

    return {f.name: plain(getattr(config, f.name)) for f in dataclasses.fields(config)}


def from_dict(kind: type[_Config], values: dict[str, Any]) -> _Config:
    """The configuration of type `kind` that `to_dict` made `values` from.

    Fields that `values` lacks keep their defaults. Raises `ValueError` naming a field that
    `kind` does not have, and one whose value is none of its type: numbers, but no NaN, for
    thresholds, whole ones for capacities.
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}
    for name in values:
        if name not in fields:
            raise ValueError(f"{kind.__name__} has no field {name!r}")

    def read(name: str, value: Any) -> Any:
        default: Any = fields[name].default
        if not _fits(value, default, fields[name].metadata.get("static", False)):
            shown = to_dict(default) if isinstance(default, eqx.Module) else default
            raise ValueError(
                f"{kind.__name__}.{name}: {repr(value)[:40]} does not fit its default {shown}"
            )
        return from_dict(type(default), value) if isinstance(value, dict) else value

    return kind(**{name: read(name, value) for name, value in values.items()})


def _fits(value: Any, default: Any, static: bool) -> bool:
    """Whether a plain value may stand where the default of a capacity or threshold does."""
    if isinstance(default, eqx.Module):
        return isinstance(value, dict)
    if isinstance(default, bool):
        return isinstance(value, bool)
    if static:
        whole = isinstance(value, int) and not isinstance(value, bool)
        return whole or (value is None and default is None)
    if isinstance(value, bool) or not isinstance(value, int | float | list):
        return False
    try:
        with np.errstate(over="raise"):
            return not np.isnan(np.asarray(value, np.float32)).any()
    except (TypeError, ValueError, OverflowError, FloatingPointError):
        return False
