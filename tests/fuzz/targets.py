"""What is fuzzed: for each kind of file, its reader, files to start from, and what must hold."""

import functools
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import jax
import numpy as np

from aprjax.features import describe
from aprjax.io.archive import check_described
from aprjax.io.log import Log, LogError
from aprjax.io.logs import read_log
from aprjax.io.occupancy_grid import OccupancyGridError, read_occupancy_grid
from aprjax.io.pose_graph import PoseGraphError, pose_graph_text, read_pose_graph
from aprjax.io.reference_file import ReferenceFileError, load_references, save_references
from aprjax.io.trajectory import TrajectoryError, read_tum
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.store import MapFileError, load_map, save_map

CASES = Path(__file__).with_name("cases")
"""A folder for each target: inputs that once broke it."""

_BREAK = b"\n--8<--\n"  # between the parts of an input that is several files, or an archive


@dataclass(frozen=True)
class Target:
    """A reader of files."""

    error: type[Exception]
    """The only one it may raise: one line that begins with a path."""
    write: Callable[[bytes, Path], Path]
    """Put an input into a folder; the path to read."""
    read: Callable[[Path], object]
    """Read it, and check what was read."""
    seeds: Callable[[Path], Iterator[bytes]]
    """Good inputs, made in a folder."""

    def check(self, data: bytes, folder: Path) -> bool:
        """Whether an input is read. Raises `AssertionError` for a wrong result or message."""
        path = self.write(data, folder)
        try:
            self.read(path)
        except self.error as error:
            message = str(error)
            assert "\n" not in message, f"several lines: {message!r}"
            assert message.startswith(str(folder)), f"no path: {message!r}"
            return False
        return True


def _one_file(name: str) -> Callable[[bytes, Path], Path]:
    def write(data: bytes, folder: Path) -> Path:
        path = folder / name
        path.write_bytes(data)
        return path

    return write


def _check_log(path: Path) -> None:
    _check_entries(read_log(path))


def _check_entries(log: Log) -> None:
    count = 0
    for entry in log:
        count += 1
        scan = entry.scan
        assert scan.ranges.dtype == np.float32
        assert scan.ranges.shape == (scan.beams,)
        assert 0 <= scan.range_min < scan.range_max < np.inf
        assert np.isfinite([scan.angle_min, scan.angle_increment, entry.stamp]).all()
        for pose in (entry.odometry, entry.logged_pose):
            assert pose is None or np.isfinite(pose).all(), f"line {entry.line}: {pose}"
    assert count == log.report.scans > 0


def _carmen_seeds(folder: Path) -> Iterator[bytes]:
    ranges = " ".join(f"{1 + 0.1 * i:.2f}" for i in range(9))
    tail = "1 2 0.5 1 2 0.5 1.5 host 1.5"
    old = f"ODOM 0 0 0 0 0 0 1 host 1\nODOM 1 0 0.1 0 0 0 1 host 1\nFLASER 9 {ranges} {tail}\n"
    new = f"RAWLASER1 0 -1.57 3.14 0.39 80 0.01 0 9 {ranges} 1 7 1.5 host 1.5\n"
    robot = (
        f"ROBOTLASER1 0 -1.57 3.14 0.39 80 0.01 0 9 {ranges} 0 1 2 0.5 1 2 0.5 0 0 0 0 0 "
        "1.5 host 1.5\n"
    )
    yield f"# robot\nPARAM laser_front_laser_resolution 1.0 0 host 0\n{2 * old}".encode()
    yield (new + robot).encode()
    yield b"VERTEX2 0 1 2 3\nEDGE2 0 1 1 2 3 1 0 1 1 0 0\nTRUEPOS 1\n" + old.encode()


def _bag_path(data: bytes, folder: Path) -> Path:
    magic = {b"#ROS": ".bag", b"\x89MCA": ".mcap", b"SQLi": ".db3"}
    path = folder / f"run{magic.get(data[:4], '.bag')}"
    path.write_bytes(data)
    return path


def _bag_seeds(folder: Path) -> Iterator[bytes]:
    from tests.io.bags import STORAGES, Bag

    for storage in STORAGES:
        (folder / storage).mkdir()
        bag = Bag(storage).scan(np.linspace(1, 3, 9), 1.0).odometry([1.0, 2.0, 0.3], 0.5)
        path = bag.transform("base_link", "laser", [0.1, 0.0, 0.2]).write(folder / storage)
        files = [path] if path.is_file() else [*path.glob("*.mcap"), *path.glob("*.db3")]
        yield from (file.read_bytes() for file in files)


def _write_grid(data: bytes, folder: Path) -> Path:
    description, _, image = data.partition(_BREAK)
    (folder / "map.pgm").write_bytes(image)
    path = folder / "map.yaml"
    path.write_bytes(description)
    return path


def _check_grid(path: Path) -> None:
    grid = read_occupancy_grid(path)
    assert grid.cells.dtype == np.int8
    assert grid.cells.min() >= -1
    assert grid.cells.max() <= 100
    assert np.isfinite([grid.resolution, *grid.T_world_grid]).all()


def _grid_seeds(folder: Path) -> Iterator[bytes]:
    common = "image: map.pgm\nresolution: 0.05\norigin: [-1.0, 2.0, 0.1]\nnegate: {}\n"
    limits = "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    pixels = bytes(range(0, 240, 20))
    yield (common.format(0) + limits).encode() + _BREAK + b"P5\n4 3\n255\n" + pixels
    text = f"mode: scale\n{common.format(1)}{limits}"
    yield text.encode() + _BREAK + b"P2 # grey\n2 2\n9\n0 3\n6 9\n"
    yield (
        (f"mode: raw\n{common.format('false')}{limits}").encode()
        + _BREAK
        + (b"P5 2 1 999\n" + bytes([0, 7, 3, 0]))
    )


def _check_graph(path: Path) -> None:
    graph = read_pose_graph(path)
    # What was read can be written.
    assert pose_graph_text(graph, "g2o") is not None


def _graph_seeds(folder: Path) -> Iterator[bytes]:
    yield (
        b"# graph\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.5\nFIX 0\nLANDMARK 3\n"
        b"EDGE_SE2 0 1 1 0 0.5 4 1 0 3 0 2\n"
    )
    yield b"VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0.5\nEDGE2 0 1 1 0 0.5 4 1 3 2 0 0\n"


def _check_trajectory(path: Path) -> None:
    stamps, poses = read_tum(path)
    assert np.isfinite(stamps).all()
    assert np.isfinite(poses).all()


def _trajectory_seeds(folder: Path) -> Iterator[bytes]:
    yield b"# stamp x y z qx qy qz qw\n1.5 1 2 0 0 0 0.6 0.8\n2.5 1 2 3 0.5 0.5 0.5 0.5\n"


def _write_archive(data: bytes, folder: Path) -> Path:
    """An archive as it is; or of parts, a name and the bytes of an array each.

    A change within an archive would only be found by its checksums.
    """
    path = folder / "file"
    if data.startswith(b"PK"):
        path.write_bytes(data)
        return path
    with zipfile.ZipFile(path, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that are there twice
        for part in data.split(_BREAK):
            name, _, content = part.partition(b"\0")
            entry = zipfile.ZipInfo(name.decode("latin-1")[:64] or "none")
            archive.writestr(entry, content)
    return path


def _archive_seeds(path: Path) -> Iterator[bytes]:
    yield path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        parts = [name.encode() + b"\0" + archive.read(name) for name in archive.namelist()]
    yield _BREAK.join(parts)


def _scans() -> list[Scan]:
    ranges = np.linspace(1, 2, 8)
    return [Scan.make(ranges, angle_min=-1, angle_increment=0.1 * i, range_max=9) for i in (1, 2)]


def _check_references(path: Path) -> None:
    # Describing scans compiles for every shape; what leads up to it is what is read.
    with mock.patch.object(ReferenceSet, "restore", _restored):
        load_references(path)


def _restored(scans: Scan, ids: np.ndarray, next_id: int, config, T_world_ref) -> None:
    assert len(ids) == len(scans.ranges) > 0
    assert np.all(np.diff(ids) > 0)
    assert next_id > ids[-1]
    assert T_world_ref is None or not np.isinf(T_world_ref).any()
    check_described(scans, config)
    _trace(np.shape(scans.ranges)[1], jax.tree.structure(config))


@functools.cache
def _trace(slots: int, structure) -> None:
    """What describes a scan, for so many slots and a configuration's capacities; nothing runs.

    Thresholds have no part in it. Once for each, since it takes a second.
    """
    config = jax.tree.unflatten(structure, [np.float32(1)] * structure.num_leaves)
    number, count = (jax.ShapeDtypeStruct((), kind) for kind in (np.float32, np.int32))
    ranges = jax.ShapeDtypeStruct((slots,), np.float32)
    jax.eval_shape(describe, Scan(ranges, number, number, number, number, count), config)


def _reference_seeds(folder: Path) -> Iterator[bytes]:
    save_references(ReferenceSet.build(_scans()), folder / "references")
    yield from _archive_seeds(folder / "references")


def _check_map(path: Path) -> None:
    world = load_map(path)
    world.check()
    # What was read can be written.
    save_map(world, path.with_name("again"))


def _map_seeds(folder: Path) -> Iterator[bytes]:
    world = WorldModel()
    for node in range(3):
        world.add_node(node)
        world.place_scan(node, Place(node, np.zeros(3)))
    for a, b, kind in ((0, 1, "driven"), (1, 2, "driven"), (2, 0, "closed")):
        world.add_arc(Arc(a, b, np.array([1.0, 0.0, 2.0]), 1e-3 * np.eye(3), kind))
    world.add_references(_scans(), [Appearance(Place(n, np.zeros(3)), n) for n in range(2)])
    world.add_image(Appearance(Place(1, np.zeros(3)), 1, image_class=3))
    save_map(world, folder / "map")
    yield from _archive_seeds(folder / "map")


TARGETS = {
    "carmen": Target(LogError, _one_file("run.log"), _check_log, _carmen_seeds),
    "bag": Target(LogError, _bag_path, _check_log, _bag_seeds),
    "grid": Target(OccupancyGridError, _write_grid, _check_grid, _grid_seeds),
    "pose_graph": Target(PoseGraphError, _one_file("run.g2o"), _check_graph, _graph_seeds),
    "trajectory": Target(
        TrajectoryError, _one_file("run.tum"), _check_trajectory, _trajectory_seeds
    ),
    "references": Target(ReferenceFileError, _write_archive, _check_references, _reference_seeds),
    "map": Target(MapFileError, _write_archive, _check_map, _map_seeds),
}


def cases(name: str) -> list[bytes]:
    """The kept inputs of a target."""
    return [path.read_bytes() for path in sorted((CASES / name).glob("*"))]
