"""Jitted programs whose traces outlive the process.

JAX's persistent cache keeps what XLA compiled, but every process traces anew what it asks for: for
a matcher of some thousand operations, that takes several times as long as loading it. Where a
folder is given (`aprjax.compilation.cache_compilations`), a `Program` keeps its traced form there
too, as JAX's portable StableHLO, and later processes call that.
"""

import hashlib
import warnings
from collections.abc import Callable
from dataclasses import fields
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
from jax import export

from aprjax.atomic import atomic_write

_Result = TypeVar("_Result", bound=eqx.Module)

_folder: Path | None = None


def keep_traces(folder: Path | None) -> None:
    """Let all programs keep their traces in an existing folder, which is trusted; None: no more."""
    global _folder
    _folder = folder


class Program(Generic[_Result]):
    """A function of trees of arrays, jitted for the device when it is first called.

    It is called with its arrays by position and the arguments named in `static` by keyword. Those
    are hashable, and their `repr` tells them apart. `returns` is the type of its result.
    """

    def __init__(
        self, function: Callable[..., _Result], returns: type[_Result], static: tuple[str, ...] = ()
    ) -> None:
        self._function, self._returns, self._static = function, returns, static
        self._kept: dict[Any, Callable[..., Any]] = {}

    @property
    def compiled(self) -> int:
        """How many programs were compiled in this process, traces of earlier ones apart."""
        return self._jitted._cache_size()

    @cached_property
    def _jitted(self) -> Any:
        return jax.jit(
            self._function, static_argnames=self._static, compiler_options=compiler_options()
        )

    def __call__(self, *arguments: Any, **static: Any) -> _Result:
        if _folder is None:
            return self._jitted(*arguments, **static)
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        precision = jax.config.jax_default_matmul_precision  # pyright: ignore[reportAttributeAccessIssue]
        key = (_folder, structure, shapes, tuple(sorted(static.items())), precision)
        if key not in self._kept:
            self._kept[key] = self._keep(_folder, leaves, structure, repr(key[1:]), static)
        return self._kept[key](leaves)

    def _keep(
        self, folder: Path, leaves: list[Any], structure: Any, key: str, static: dict[str, Any]
    ) -> Callable[[list[Any]], _Result]:
        """The program for arguments like these, from its trace in the folder or a new one there."""

        def flat(*leaves: Any) -> list[Any]:
            return jax.tree.leaves(self._function(*jax.tree.unflatten(structure, leaves), **static))

        name = self._function.__name__.strip("_")
        digest = hashlib.sha256(f"{name}\n{key}\n{_surroundings()}".encode()).hexdigest()
        path = folder / f"{name}-{digest}.trace"
        trace = _load(path)
        if trace is None:
            try:
                trace = export.export(jax.jit(flat))(*leaves)
            except ValueError:  # it has operations that JAX's portable form has not
                return lambda leaves: self._jitted(*jax.tree.unflatten(structure, leaves), **static)
            _store(path, bytes(trace.serialize()))
        called = jax.jit(trace.call, compiler_options=compiler_options())
        result = jax.tree.structure(_skeleton(self._returns))
        return lambda leaves: jax.tree.unflatten(result, called(*leaves))


@cache
def compiler_options() -> dict[str, bool | str]:
    """How XLA is to compile the matcher on a CPU.

    By default XLA orders what runs on a CPU so that much of it may run at the same time, and hands
    sums to a library. Here chunks run at the same time; threads and a library that are handed
    single small operations cost a quarter of the time.
    """
    found: dict[str, bool | str] = {}
    for name, value in (
        ("xla_cpu_enable_concurrency_optimized_scheduler", False),
        ("xla_cpu_experimental_ynn_fusion_type", ""),
    ):
        try:
            jax.jit(lambda: 0, compiler_options={name: value}).lower().compile()
        except jax.errors.JaxRuntimeError:  # another XLA, which does not know it
            continue
        found[name] = value
    return found


_DIGEST = hashlib.sha256().digest_size


def _load(path: Path) -> export.Exported | None:
    """The trace in a file; None where there is none, or a broken one."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    digest, trace = stored[:_DIGEST], stored[_DIGEST:]
    if hashlib.sha256(trace).digest() != digest:
        return None
    return export.deserialize(bytearray(trace))


def _store(path: Path, trace: bytes) -> None:
    """Write a trace, complete or not at all; a folder that takes none is only warned about."""
    try:
        with atomic_write(path, "wb") as file:
            file.write(hashlib.sha256(trace).digest() + trace)
    except OSError as error:
        warnings.warn(f"{path}: not kept for later processes ({error.strerror})", stacklevel=2)


@cache
def _surroundings() -> str:
    """Whatever else decides what is traced: this package's code, others' versions, the device."""
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        sources.update(path.read_bytes())
    versions = [
        f"{name} {metadata.version(name)}"
        for name in ("jax", "jaxlib", "equinox", "lineax", "optimistix")
    ]
    return f"{sources.hexdigest()} {versions} {jax.devices()[0].device_kind}"


def _skeleton(kind: type[eqx.Module]) -> eqx.Module:
    """A module with a number for each array, for its structure alone."""
    made = object.__new__(kind)
    for field in fields(kind):
        of: Any = field.type
        nested = isinstance(of, type) and issubclass(of, eqx.Module)
        object.__setattr__(made, field.name, _skeleton(of) if nested else 0)
    return made
