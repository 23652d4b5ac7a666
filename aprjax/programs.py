"""Jitted programs whose traces outlive the process.

JAX's persistent cache keeps what XLA compiled, but every process traces anew what it asks for: for
a matcher of some thousand operations, that takes several times as long as loading it. Where a
folder is given (`aprjax.compilation.cache_compilations`), a `Program` keeps its traced form there
too, as JAX's portable StableHLO, and later processes call that.
"""

import hashlib
import warnings
import weakref
from collections.abc import Callable
from dataclasses import fields
from functools import cache, cached_property, wraps
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jaxlib
import lineax as lx
import optimistix as optx
from jax import core, export

from aprjax.atomic import atomic_write

_Result = TypeVar("_Result", bound=eqx.Module)


class _Store(NamedTuple):
    """Where traces are kept, and what they hold for."""

    folder: Path
    surroundings: str


_store: _Store | None = None
_programs: "weakref.WeakSet[Program[Any]]" = weakref.WeakSet()
_FEW = 4  # programs that are kept in any case: there is no forgetting at every call
_LIMIT = Path("/proc/sys/vm/max_map_count")
_CROWDED = 0.7  # of the memory mappings that a process may have


def keep_traces(folder: Path | None) -> None:
    """Let all programs keep their traces in an existing folder, which is trusted; None: no more.

    Traces hold for the code and the versions that are there at this moment. Call it at the
    beginning, as long as these are what has been imported.
    """
    global _store
    _store = None if folder is None else _Store(folder, surroundings())


class Program(Generic[_Result]):
    """A function of trees of arrays, jitted for the device when it is first called.

    It is called with its arrays by position, and by keyword with the arguments named in `static`,
    which are hashable and told apart by their `repr`. `returns` is the type of its result: modules
    in modules, all fields arrays. It is called from outside of JAX's transformations. Whatever is
    amiss with a trace costs time, not the answer: then the function is jitted as it is.
    """

    def __init__(
        self, function: Callable[..., _Result], returns: type[_Result], static: tuple[str, ...] = ()
    ) -> None:
        self._function, self._returns, self._static = function, returns, static
        self._jitted: dict[_Store | None, Any] = {}
        _programs.add(self)

    @property
    def compiled(self) -> int:
        """How many programs this process has compiled or loaded, and not forgotten."""
        return sum(jitted._cache_size() for jitted in set(self._jitted.values()))

    def forget(self) -> None:
        """Let go of what was compiled or loaded."""
        for jitted in set(self._jitted.values()):
            jitted.clear_cache()

    def __call__(self, *arguments: Any, **static: Any) -> _Result:
        before, store = self.compiled, _store
        try:
            result = self._jitted_for(store)(*arguments, **static)
        except Exception as error:
            if store is None:
                raise
            # If it was not the trace, this raises the same.
            result = self._jitted_for(None)(*arguments, **static)
            self._jitted[store] = self._jitted_for(None)
            warnings.warn(f"{self._name}: without its trace from now on ({error})", stacklevel=2)
        if self.compiled > before:
            _make_room()
        return result

    def _jitted_for(self, store: _Store | None) -> Any:
        """The function, jitted: as it is, or by its traces in a folder."""
        if store not in self._jitted:
            jitted = jax.jit(
                self._function if store is None else self._by_trace(store),
                static_argnames=self._static,
                compiler_options=compiler_options(),
            )
            self._jitted.setdefault(store, jitted)
        return self._jitted[store]

    def _by_trace(self, store: _Store) -> Callable[..., _Result]:
        """The function, for JAX to trace: its trace in the folder, or a new one that is put there.

        So it is JAX that finds what is compiled already, at the least cost for a call.
        """

        @wraps(self._function)
        def traced(*arguments: Any, **static: Any) -> _Result:
            leaves, structure = jax.tree.flatten(arguments)
            if _plain(leaves):
                trace = self._trace(store, leaves, structure, static)
                if trace is not None:
                    return jax.tree.unflatten(self._returned, trace.call(*leaves))
            return self._function(*arguments, **static)

        return traced

    @property
    def _name(self) -> str:
        return f"{self._function.__module__}.{self._function.__qualname__}"

    @cached_property
    def _returned(self) -> Any:
        """The structure of what the function returns."""
        return jax.tree.structure(_skeleton(self._returns))

    def _trace(
        self, store: _Store, leaves: list[Any], structure: Any, static: dict[str, Any]
    ) -> export.Exported | None:
        """The trace for arguments like these; None, and a warning, if there can be none."""
        function, name = self._function, self._name
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        settings = tuple(getattr(jax.config, setting) for setting in _SETTINGS)
        key = repr((structure, shapes, tuple(sorted(static.items())), settings))
        device = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
        if not isinstance(device, jax.Device):  # the name of a platform, or none
            device = jax.devices(device)[0]
        told = [name, key, store.surroundings, device.platform, device.device_kind]
        digest = hashlib.sha256("\n".join(told).encode()).hexdigest()
        path = store.folder / f"{function.__name__.strip('_')}-{digest}.trace"

        def flat(*leaves: Any) -> list[Any]:
            made = function(*jax.tree.unflatten(structure, leaves), **static)
            if jax.tree.structure(made) != self._returned:
                raise TypeError(f"{name}: its result is not made of arrays as {self._returns} says")
            # Types as those of a trace that is loaded: the program that is given this result is
            # then the same one in the process that made the trace and in later ones.
            arrays = map(jnp.asarray, jax.tree.leaves(made))
            return [jax.lax.convert_element_type(array, array.dtype) for array in arrays]

        trace = None
        try:
            trace = _load(path)
            if trace is None:
                like = [jax.ShapeDtypeStruct(*shape) for shape in shapes]
                default = device.platform == jax.default_backend()
                platforms = None if default else [device.platform]
                trace = export.export(jax.jit(flat), platforms=platforms)(*like)
                with atomic_write(path, "wb") as file:
                    file.write(_signed(bytes(trace.serialize())))
        except Exception as error:  # a trace that was made, and not written, serves this process
            warnings.warn(f"{path}: not kept for later processes ({error})", stacklevel=2)
        return trace


def _make_room() -> None:
    """Forget all programs if there may be no room for another one."""
    programs = list(_programs)
    if sum(program.compiled for program in programs) > _FEW and _crowded():
        for program in programs:
            program.forget()


def _crowded(
    share: float = _CROWDED, process: Path = Path("/proc/self/maps"), limit: Path = _LIMIT
) -> bool:
    """Whether this process has that share of the memory mappings it may have; only Linux tells."""
    try:
        taken = process.read_bytes().count(b"\n")
        return taken > share * int(limit.read_text())
    except (OSError, ValueError):
        return False


_SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_default_device")
"""Of JAX, which change what is traced."""


def _plain(leaves: list[Any]) -> bool:
    """Whether a trace can stand for these arguments: arrays in JAX's hands, none weakly typed."""
    return all(isinstance(leaf, core.Tracer) and not leaf.weak_type for leaf in leaves)


@cache
def compiler_options() -> dict[str, bool | str]:
    """How XLA is to compile the matcher on a CPU.

    By default XLA orders what runs on a CPU so that much of it may run at the same time, hands sums
    to a library, and breaks long ones into two. Here chunks run at the same time: threads that are
    handed single small operations cost a quarter of the time, and the library a few hundredths.
    Sums are of some hundred numbers, for which float32 is exact enough: in two parts they are no
    faster, and take a seventh longer to compile. A pass that XLA does not know is no error.
    """
    found: dict[str, bool | str] = {}
    for name, value in (
        ("xla_cpu_enable_concurrency_optimized_scheduler", False),
        ("xla_cpu_experimental_ynn_fusion_type", ""),
        ("xla_disable_hlo_passes", "tree_reduction_rewriter"),
    ):
        try:
            jax.jit(lambda: 0, compiler_options={name: value}).lower().compile()
        except jax.errors.JaxRuntimeError:  # another XLA, which does not know it
            continue
        found[name] = value
    return found


_DIGEST = hashlib.sha256().digest_size


def _signed(trace: bytes) -> bytes:
    """A trace with its digest before it."""
    return hashlib.sha256(trace).digest() + trace


def _load(path: Path) -> export.Exported | None:
    """The trace in a file; None where there is none, or a broken one."""
    try:
        stored = path.read_bytes()
    except FileNotFoundError:
        return None
    trace = stored[_DIGEST:]
    return export.deserialize(bytearray(trace)) if stored == _signed(trace) else None


def surroundings(package: Path = Path(__file__).parent) -> str:
    """What decides what is traced and computed: the package's code and data, others' versions."""
    files = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            content = path.read_bytes()
            files.update(f"{path.relative_to(package)} {len(content)}\n".encode() + content)
    versions = [f"{each.__name__} {each.__version__}" for each in (jax, jaxlib, eqx, lx, optx)]
    return f"{files.hexdigest()} {versions}"


def _skeleton(kind: type[eqx.Module]) -> eqx.Module:
    """A module with a number for each array, for its structure alone."""
    made = object.__new__(kind)
    for field in fields(kind):
        of: Any = field.type
        nested = isinstance(of, type) and issubclass(of, eqx.Module)
        object.__setattr__(made, field.name, _skeleton(of) if nested else 0)
    return made
