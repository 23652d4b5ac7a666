"""Fields of configurations, and configurations as plain dictionaries.

A configuration is an equinox module. Thresholds are array leaves, so that a new value never
retraces and a sweep is a `vmap`; capacities set array sizes and are static.
"""

import dataclasses
import operator
from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_Config = TypeVar("_Config", bound=eqx.Module)


def threshold(default: float, doc: str, *, least: float = 0.0, most: float = np.inf) -> Any:
    """A field that is a float32 array leaf, finite and from `least` to `most`, both rounded to it.

    NumPy holds the value, so that building a configuration touches no device. The constructor
    raises `ValueError` naming the field, the index and the value of one out of its range; JAX's
    arrays, and leaves that JAX puts into a configuration, are not looked at. The field's metadata
    hold the range.
    """
    # Values are compared as float32: an angle of π is from 0 to π.
    lowest, highest = np.float32(least), np.float32(most)

    def convert(value: Any) -> Any:
        # A weakly typed array would trace anew, so JAX's arrays are pinned too.
        if isinstance(value, jax.Array):
            return jax.lax.convert_element_type(value, np.float32)
        given = real_numbers(value)
        if given is None:
            raise ValueError(f"{field.name}: {shown(value)} is not a number")
        with np.errstate(over="ignore"):
            array = given.astype(np.float32)  # nobody else's
        right = np.isfinite(array) & (array >= lowest) & (array <= highest)
        if not right.all():
            first = tuple(np.argwhere(~right)[0])
            at = ", ".join(map(str, first))
            which = f"[{at}]: {array[first]}" if at else f": {shown(value)}"
            raise ValueError(f"{field.name}{which} is not {_range(least, most)}")
        return array

    field = _field(default, convert, {"doc": doc, "least": least, "most": most})
    return field


def capacity(default: int | None, doc: str, *, least: int = 1) -> Any:
    """A field that sets an array size: static, so a new value compiles anew.

    A whole number from `least`, None where the default is, or a choice where the default is True
    or False; the constructor raises `ValueError` naming the field for anything else.
    """

    def convert(value: Any) -> int | None:
        if isinstance(default, bool):
            if not isinstance(value, bool | np.bool_):
                raise ValueError(f"{field.name}: {shown(value)} is not True or False")
            return bool(value)
        if value is None and default is None:
            return None
        try:
            if value is None or isinstance(value, bool):  # True is a whole number to Python
                raise TypeError
            number = operator.index(value)
        except TypeError:
            number = least - 1
        if number < least:
            raise ValueError(f"{field.name}: {shown(value)} is not a whole number from {least}")
        return number

    field = _field(default, convert, {"doc": doc}, static=True)
    return field


class Packed(eqx.Module, Generic[_Config]):
    """A configuration with all its thresholds in one array, as programs are given it.

    Each array takes a way of its own to the device, and through the host at each call.
    """

    thresholds: Float[Array, " thresholds"]
    _structure: Any = eqx.field(static=True)

    @classmethod
    def of(cls, config: _Config, name: str = "config") -> Self:
        """Of a configuration, which an error calls by its `name`. Raises as `check_single`."""
        thresholds, structure = jax.tree.flatten(config)
        if any(map(np.ndim, thresholds)):
            check_single(config, name)
        return cls(np.array(thresholds, np.float32), structure)  # pyright: ignore[reportArgumentType]

    @property
    def config(self) -> _Config:
        """The configuration; only in a program, where its thresholds are arrays."""
        return jax.tree.unflatten(self._structure, list(self.thresholds))

    def __reduce__(self) -> tuple[Any, ...]:
        # The copy of a structure would not be equal to it, that of a configuration's is.
        like = jax.tree.unflatten(self._structure, range(self._structure.num_leaves))
        return _repacked, (self.thresholds, like)


def _repacked(thresholds: Any, like: _Config) -> Packed[_Config]:
    """For copies: thresholds of a configuration that is like another one but for them."""
    return Packed(thresholds, jax.tree.structure(like))


def check_kind(name: str, value: Any, kind: type) -> None:
    """Raise `ValueError` naming an argument that is of another kind."""
    if not isinstance(value, kind):
        raise ValueError(f"{name}: {type(value).__name__} is no {kind.__name__}")


def check_single(config: eqx.Module, name: str = "config") -> None:
    """Raise `ValueError` naming a threshold that is several numbers, as for a sweep."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(config):
        if np.ndim(leaf):
            raise ValueError(
                f"{name}{jax.tree_util.keystr(path)}: shape {np.shape(leaf)} is not a single "
                "number; aprjax.sweep takes several"
            )


def _field(
    default: Any, convert: Callable[[Any], Any], metadata: dict[str, Any], static: bool = False
) -> Any:
    """A field whose `name` is known to `convert` by the time it is called."""
    return eqx.field(default=default, converter=convert, static=static, metadata=metadata)


def _range(least: float, most: float) -> str:
    if most < np.inf:
        return f"a number from {least:g} to {most:g}"
    return f"a finite number from {least:g}" if least > -np.inf else "a finite number"


def real_numbers(values: Any) -> np.ndarray | None:
    """Whole or floating-point numbers as an array of what they are; None for anything else."""
    try:
        given = np.asarray(values)
    except ValueError:  # lists of several lengths
        return None
    kind = given.dtype
    # JAX knows more types, such as bfloat16, but takes long to say so.
    real = (
        kind.kind in "iuf"
        or jnp.issubdtype(kind, jnp.integer)
        or jnp.issubdtype(kind, jnp.floating)
    )
    return given if real else None


def shown(value: Any) -> str:
    """A value in one short line, for messages."""
    text = str(value) if isinstance(value, int | float | np.generic) else repr(value)
    return " ".join(text.split())[:40]


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
    `kind` does not have, and as the constructor of `kind` for one whose value is not in its range.
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}
    for name in values:
        if name not in fields:
            raise ValueError(f"{kind.__name__} has no field {name!r}")

    def read(name: str, value: Any) -> Any:
        default: Any = fields[name].default
        if not isinstance(default, eqx.Module):
            return value
        if not isinstance(value, dict):
            raise ValueError(f"{name}: {shown(value)} is not a group of fields")
        return from_dict(type(default), value)

    return kind(**{name: read(name, value) for name, value in values.items()})
