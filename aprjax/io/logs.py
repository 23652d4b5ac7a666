"""Logs of every format this package reads, told apart by their contents."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from aprjax.io.bag_file import is_bag, is_compressed
from aprjax.io.carmen import read_carmen
from aprjax.io.log import Log, LogError
from aprjax.io.rosbag import read_bag


def read_log(
    path: str | os.PathLike[str],
    *,
    lasers: Sequence[str] | None = None,
    odometry: str | Literal[False] | None = None,
    strict: bool = False,
) -> Log:
    """Survey a log and return it ready to be iterated: CARMEN's, or a ROS bag.

    A bag is a file of ROS 1, or of ROS 2 a folder, an MCAP or an SQLite file; it asks for the
    extra `aprjax[rosbag]`. `lasers` names the messages of a CARMEN log to take, see
    `read_carmen`, or the topics of a bag. `odometry` is the topic of a bag's odometry, by default
    the only one; False for none. See `read_bag`. `strict` raises at the first damaged line or
    message instead of skipping it.

    Raises `LogError` for a file that cannot be read, is cut off or corrupt, or has no scan of the
    lasers asked for, and for a topic of odometry in a CARMEN log; `ValueError` for a laser message
    that does not exist.
    """
    path = Path(path)
    if is_bag(path):
        return read_bag(path, lasers=lasers, odometry=odometry, strict=strict)
    if is_compressed(path):
        raise LogError(
            f"{path}: compressed by zstd; of a bag that is, give the folder with metadata.yaml"
        )
    if odometry:
        raise LogError(f"{path}: not a bag, so there is no topic {odometry}")
    return read_carmen(path, lasers=lasers, strict=strict)
