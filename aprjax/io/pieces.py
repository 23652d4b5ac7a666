"""Pieces of a long computation, kept on disk until it is complete.

A run that was interrupted goes on where it was when it is started again. The folder belongs to one
run, told by its fingerprint: pieces of another are thrown away, not mixed in.
"""

import hashlib
from contextlib import suppress
from pathlib import Path

import jax
import numpy as np

from aprjax.atomic import atomic_write, is_temporary
from aprjax.io.archive import ArchiveError, archive_format, read_archive
from aprjax.programs import surroundings

_FORMAT = "aprjax pieces"
_VERSION = 2


def fingerprint(*inputs: object) -> str:
    """A digest of all that a result depends on: trees of arrays, code, versions, and the device."""
    device = jax.devices()[0]
    digest = hashlib.sha256(f"{surroundings()} {device.platform} {device.device_kind}".encode())
    leaves, structure = jax.tree.flatten(inputs)
    digest.update(str(structure).encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class Pieces:
    """The finished pieces of one run in a folder of their own."""

    def __init__(self, folder: Path, run: str) -> None:
        """Those of the run with this `fingerprint`, of which there may be none."""
        self._folder, self._run = folder, run

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The columns of a finished piece; None if it is not there, damaged, or of another run."""
        try:
            archive = read_archive(self._folder / f"{name}.npz", "piece")
            archive.check_format(_FORMAT, _VERSION)
            columns = archive.all()
        except ArchiveError:
            return None
        if str(columns.pop("run", "")) != self._run:
            return None
        return {name: columns[name] for name in columns if name not in ("format", "version")}

    def store(self, name: str, columns: dict[str, np.ndarray]) -> None:
        """Keep a piece under a name of its own. Raises `OSError`."""
        self._folder.mkdir(exist_ok=True)
        with atomic_write(self._folder / f"{name}.npz", "wb") as file:
            np.savez(
                file,
                format=np.array(_FORMAT),
                version=np.int64(_VERSION),
                run=np.array(self._run),
                **columns,  # pyright: ignore[reportArgumentType]
            )

    def discard(self) -> None:
        """Remove all pieces, when the result that they were for is written.

        The folder goes with them unless something else is in it, which stays.
        """
        with suppress(OSError):
            for path in self._folder.iterdir():
                # Temporary files are of runs that were killed while they wrote a piece.
                if is_temporary(path) or (path.is_file() and archive_format(path) == _FORMAT):
                    path.unlink()
            self._folder.rmdir()
