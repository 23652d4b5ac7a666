"""Paying for compilation when it suits: ahead of time, and once for all processes.

# Performance and shapes

JAX compiles a program for each combination of array shapes. aprjax pads to few of them:

- *Beams* of a scan and *references* of a set are padded to buckets, four to the octave. A set that
  grows by one compiles again only where it leaves its bucket.

  ```python
  >>> from aprjax.numerics import bucket
  >>> [bucket(references) for references in (3, 8, 9, 30, 225)]
  [8, 8, 10, 32, 256]

  ```

- *Scans* are described, and queries matched, in chunks of one size: of 32, queries of
  `MatchConfig.chunk`. On a CPU, where there are not enough for a chunk on each core, they are as
  quick one by one, by the programs of a single scan: there are two programs of each kind, whatever
  the number. On an accelerator a chunk that is not filled is one of 1, 2, 4, …
- *References and queries* of one bucket of beams are described by the same programs, where they
  come in chunks of the same size: after a set has been built of a few scans, a single match has
  only the rest to compile; after one of many, that of many queries.

- *Capacities* of a configuration (anchors, alternatives, hypotheses, `top_k`) set array sizes:
  another value compiles anew. Where one does not suffice, the result says so
  (`Status.CAPACITY_EXCEEDED`, `Counts.overflow`).
- *Thresholds* are array leaves: another value compiles nothing.

The first call therefore takes long, and later ones do not. Three things help:

- `warm_up` compiles ahead of time, for so many beams and queries in a call;
- `cache_compilations` keeps what is traced and compiled for later processes: reference sets and
  matches, those with a catalogue too, neither trace nor compile there what an earlier one did with
  the same code, versions and device (`aprjax.programs`); all else, such as a catalogue's
  signatures and their comparison, is traced anew, but not compiled;
- scans in lists (`match_batch(scans, references)`) are padded to buckets, a stacked `Scan` is taken
  as it is: pad it alike (`Scan.pad`) to share what was compiled.

Many queries at once are quicker than one at a time: on a CPU they are shared among its cores, in
chunks that also bound the memory; on an accelerator the queries of a chunk are worked on
together. Most of a query's time does not depend on the number of references: votes
grow with it, the looks at alternatives and the synthetic scans do not. `python -m benchmarks`
measures all this on the machine at hand, and `python -m benchmarks stages` says where the time
goes.

A `ReferenceSet` takes some 25 kB a reference; while a query votes, 3 MB and 0.8 kB a reference more
on each core, and `chunk` queries at a time bound all else. `aprjax.sharding` spreads references
over devices, `aprjax.catalogue` keeps a million of them in little memory.

Linux bounds how many programs a process can hold: on a CPU, a few dozen of the matcher's. Before
that, aprjax forgets those it has compiled, and what is called again is compiled again, or loaded
(`aprjax.programs`).

Results lie on the host, as NumPy arrays. Importing aprjax compiles nothing and touches no device.
"""

import os
import stat
from collections.abc import Iterable
from pathlib import Path

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

from aprjax.batch import match_batch
from aprjax.matcher import MatchConfig
from aprjax.programs import keep_traces
from aprjax.references import ReferenceSet
from aprjax.scan import Scan


def warm_up(
    references: ReferenceSet,
    beams: int,
    batches: Iterable[int] = (1,),
    config: MatchConfig | None = None,
) -> None:
    """Compile what matching these references will need, so that no later call has to.

    `beams` is the number of beams of the queries, `batches` the numbers of queries in a call; 1
    is `match`. Matching after references were added needs another compilation only where their
    number leaves the bucket (see `numerics.bucket`), and other thresholds never do. Raises
    `ValueError` for numbers that are not positive and for no references.
    """
    for name, values in (("beams", [beams]), ("batches", batches := list(batches))):
        for index, value in enumerate(values):
            if value < 1:
                raise ValueError(f"{name}[{index}]: {value} is not a positive number")
    blank = Scan.make(
        np.full(beams, np.nan), angle_min=0.0, angle_increment=2 * np.pi / beams, range_max=1.0
    )
    for queries in batches:
        match_batch([blank] * queries, references, config)


def cache_compilations(folder: str | os.PathLike[str] | None = None) -> Path:
    """Keep what is traced and compiled in a folder for later processes; returns the folder.

    This is a setting of the whole process: it makes JAX's persistent compilation cache take
    small and quick compilations too. `folder` is made, for the user alone, if it does not
    exist; by default it is `aprjax` in `$XDG_CACHE_HOME`, else in `~/.cache`. Cached programs are
    executed, so a folder of another user, or that others can write to, is refused with a
    `PermissionError`. Nothing is ever deleted from it, and other code or versions need programs of
    their own; it may be removed at any time. Call it soon after the import: traces are kept for
    the code that is installed then (`aprjax.programs`).
    """
    if folder is None:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "aprjax"
    path = Path(folder).expanduser().absolute()
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid"):  # Windows has neither owners nor modes of this kind
        found = path.stat()
        if found.st_uid != os.getuid():
            raise PermissionError(f"{path}: it is another user's; cached programs are executed")
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError(f"{path}: others can write to it; cached programs are executed")
    keep_traces(path)
    # JAX goes on with the folder that it has begun to use, unless it is told to forget it.
    compilation_cache.reset_cache()
    jax.config.update("jax_compilation_cache_dir", str(path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return path
