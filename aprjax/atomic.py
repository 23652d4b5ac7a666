"""Files that are either the old ones or complete new ones, never half written."""

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """A file to write, which takes the name `path` only when the block ends without an error.

    Text is UTF-8 with newlines as written. Until then the bytes are in a temporary file of the
    same folder, which an error removes; what was at `path` stays. The permissions are those of
    any new file (the umask). A symbolic link keeps pointing where it did. Raises `OSError`
    naming `path` where it cannot be written, also where a full disk shows only in the block.
    """
    target = Path(path).resolve()
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    # A device or a pipe (/dev/null, /dev/stdout) is written to: replacing it would destroy it.
    if target.exists() and not target.is_file():
        with _named(path), target.open(mode, **text) as file:
            yield file
        return
    # Not tempfile, whose files are private to the user whatever the umask.
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with _named(path):
            with temporary.open(mode.replace("w", "x"), **text) as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def is_temporary(path: Path) -> bool:
    """Whether a file has the name of one that `atomic_write` had not finished."""
    return re.fullmatch(r"\.[0-9a-f]{16}\.tmp", path.name) is not None


@contextmanager
def _named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Let an `OSError` name the file that was to be written, not a passing one or none."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from error
