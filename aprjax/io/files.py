"""Files as every reader opens them, and how much one of its size may hold."""

import errno
import os
import stat
from pathlib import Path
from typing import IO

MOST_BEAMS = 1 << 16
"""Of a scan: more are a mistake, or meant to do harm."""
_PACKED = 100  # times that what a file holds may be longer than it is,
_SMALL = 1 << 26  # where it is longer than this


def open_file(path: Path) -> IO[bytes]:
    """A regular file to read. Raises `OSError` as `check_file` does."""
    check_file(path)
    return path.open("rb")


def check_file(path: Path) -> None:
    """Raise `OSError` for what is no regular file, and for a path that no file can have.

    Files are read more than once, which a pipe cannot be; and opening one waits for its writer.
    """
    name = os.fspath(path)
    try:
        mode = path.stat().st_mode
    except ValueError:
        raise OSError(errno.EINVAL, "no file has such a name", name) from None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), name)
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "a pipe or device is not read; write it to a file first", name)


def most_unpacked(size: int) -> int:
    """Bytes that what is packed in `size` bytes may be long: 64 MiB, or 100 times as many."""
    return max(_SMALL, _PACKED * size)
