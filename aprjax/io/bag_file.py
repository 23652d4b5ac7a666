"""The file or folder of a ROS bag: its topics, and its messages one by one."""

import bz2
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aprjax.io.files import check_file, most_unpacked, open_file
from aprjax.io.log import LogError

_MAGIC = {b"#ROSBAG V": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3": ".db3"}
_ZSTANDARD = b"\x28\xb5\x2f\xfd"
_LISTED = 5  # bags of a folder that are named
_MENDED_BY = {
    ".bag": "`rosbag reindex`",
    ".mcap": "`mcap recover`",
    ".db3": "`ros2 bag reindex`",
}


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str
    kind: str
    """The type of its messages, such as sensor_msgs/msg/LaserScan."""
    messages: int


def is_bag(path: str | os.PathLike[str]) -> bool:
    """Whether a file begins as a bag does; every folder is taken for one."""
    path = Path(path)
    return _is_folder(path) or _suffix(path) is not None


def is_compressed(path: str | os.PathLike[str]) -> bool:
    """Whether a file is zstd's, as ROS 2 leaves the files of a bag that it compresses."""
    return _head(Path(path)).startswith(_ZSTANDARD)


def bag_topics(path: str | os.PathLike[str]) -> list[Topic]:
    """The topics of a bag by their names. Raises `LogError` as `read_bag` does."""
    with opened(Path(path)) as reader:
        return topics_of(reader)


def topics_of(reader: Any) -> list[Topic]:
    """The topics of an open bag by their names."""
    return [
        Topic(name, info.msgtype or "", info.msgcount)
        for name, info in sorted(reader.topics.items())
    ]


def messages_of(
    path: Path, reader: Any, topics: Sequence[str]
) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Topic, time in nanoseconds, and a function that reads the message or raises `ValueError`."""
    connections = [each for each in reader.connections if each.topic in topics]
    messages = reader.messages(connections=connections)
    count = 0
    while True:
        # Damage shows as whatever the storage's own parsers stumble over.
        try:
            connection, time, data = next(messages)
        except StopIteration:
            return
        except Exception as error:
            raise LogError(
                f"{path}: cut off or damaged after {count} messages: {_line(error)}{_advice(path)}"
            ) from None
        count += 1

        def read(connection: Any = connection, data: Any = data) -> Any:
            try:
                return reader.deserialize(data, connection.msgtype)
            except Exception as error:
                raise ValueError(_line(error)) from None

        yield connection.topic, time, read


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The bag's reader."""
    try:
        for each in _files(path):
            check_file(each)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(
            f"{path}: reading a bag asks for the rosbags package: pip install 'aprjax[rosbag]'"
        ) from None
    suffix = _suffix(path)
    if suffix is not None and path.suffix != suffix:
        advice = _advice(path) if path.suffix == ".active" else ""
        raise LogError(f"{path}: a bag, but its name does not end in {suffix}{advice}")
    try:
        # The messages read here are the same in every ROS 2 there was.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:
        raise LogError(f"{path}: not a readable bag: {_line(error)}{_advice(path)}") from None
    try:
        _limit(path, reader)
        yield reader
    finally:
        reader.close()


def _files(path: Path) -> list[Path]:
    """The files of a bag. Raises `LogError` for a folder that is none, and `OSError`."""
    if not path.is_dir():
        return [path]
    if not (path / "metadata.yaml").is_file():
        within = [each.name for each, _ in _bags_within(path)]
        found = f"; it holds {', '.join(within[:_LISTED])}: read one at a time" if within else ""
        raise LogError(f"{path}: a folder without metadata.yaml, so not a bag of ROS 2{found}")
    return [each for each in path.iterdir() if each.exists() and not each.is_dir()]


def _limit(path: Path, reader: Any) -> None:
    """Let no chunk of an open bag be unpacked to more than one of its size may hold.

    LZ4 packs no more than 255 times, so that ROS 1's chunks need a limit only by bzip2.
    """
    for each in reader.readers:
        for at, chunk in getattr(each, "chunks", {}).items():
            if chunk.decompressor is bz2.decompress:
                each.chunks[at] = chunk._replace(decompressor=_unpacked)
        storage = getattr(each, "storage", None)
        for file in getattr(storage, "storages", [storage]):
            for chunk in getattr(file, "chunks", ()):  # of MCAP
                size, claimed = chunk.compressed_size, chunk.uncompressed_size
                if claimed > most_unpacked(size):
                    raise LogError(
                        f"{path}: a chunk claims to hold {claimed} bytes, too many for its {size}"
                    )


def _unpacked(data: bytes) -> bytes:
    """What a chunk of bzip2's holds. Raises `ValueError`, before it takes more memory."""
    stream, most = bz2.BZ2Decompressor(), most_unpacked(len(data))
    unpacked = stream.decompress(data, max_length=most)
    if not stream.eof:
        raise ValueError(f"a chunk of {len(data)} bytes is cut off, or holds over {most}")
    return unpacked


def _advice(path: Path) -> str:
    """What to do with a bag that is damaged: mostly, its recording was cut off."""
    suffix = _suffix(path)
    if suffix is None and _is_folder(path):
        suffix = next((suffix for _, suffix in _bags_within(path)), None)
    return f" (if its recording was cut off, {_MENDED_BY[suffix]} mends it)" if suffix else ""


def _is_folder(path: Path) -> bool:
    """Whether a path is a folder's, as far as can be seen."""
    try:
        return path.is_dir()
    except OSError:
        return False


def _bags_within(folder: Path) -> list[tuple[Path, str]]:
    """The files of a folder that begin as a bag does, and the suffixes they should have."""
    try:
        files = sorted(folder.iterdir())
    except OSError:
        return []
    return [(each, suffix) for each in files if (suffix := _suffix(each)) is not None]


def _suffix(path: Path) -> str | None:
    """The suffix that a bag file should have, None for any other file and for a folder."""
    head = _head(path)
    return next((suffix for magic, suffix in _MAGIC.items() if head.startswith(magic)), None)


def _head(path: Path) -> bytes:
    """How a file begins; nothing of what cannot be read."""
    try:
        with open_file(path) as file:
            return file.read(16)
    except OSError:
        return b""


def _line(error: Exception) -> str:
    """The first line of an error's message."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]
