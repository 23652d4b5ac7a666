"""Files that commands write: found to be writable before any long computation."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from aprjax.cli.errors import CommandError


def check_outputs(paths: Iterable[Path | None], *inputs: Path) -> None:
    """Raise `CommandError` as `check_output` does, and where two of the `paths` are one file."""
    seen: set[Path] = set()
    for path in paths:
        if path is None:
            continue
        check_output(path, *inputs)
        target = path.resolve()
        if target in seen and (target.is_file() or not target.exists()):
            raise CommandError(f"{path}: would be written twice")
        seen.add(target)


def shown_path(path: str | Path) -> str:
    """A path as text that any file can hold: names need not be Unicode."""
    return os.fsencode(path).decode(errors="replace")


def check_output(path: Path, *inputs: Path) -> None:
    """Raise `CommandError` unless `path` can be written and is none of the `inputs`."""
    target = path.resolve()
    try:
        if target.is_dir():
            raise CommandError(f"{path}: is a directory")
        if target.exists() and not target.is_file():
            if not os.access(target, os.W_OK):
                raise CommandError(f"{path}: cannot be written")
            return
        for source in inputs:
            if target.exists() and source.exists() and target.samefile(source):
                raise CommandError(f"{path}: would overwrite what is read")
        # Permissions do not tell for the superuser and read-only file systems: try it.
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from None


def make_folder(path: Path) -> None:
    """Make the folder `path` if need be; raise `CommandError` unless it can be written into."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from None
