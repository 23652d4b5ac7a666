"""What no reader opens: pipes, devices, and names that no file can have."""

import os

import pytest

from aprjax.io.files import check_file, most_unpacked
from aprjax.io.log import LogError
from aprjax.io.logs import read_log
from aprjax.io.occupancy_grid import OccupancyGridError, read_occupancy_grid
from aprjax.io.pose_graph import PoseGraphError, read_pose_graph
from aprjax.io.reference_file import ReferenceFileError, load_references, looks_like_references
from aprjax.io.trajectory import TrajectoryError, read_tum
from aprjax.world.store import MapFileError, load_map, looks_like_map

READERS = [
    (read_log, LogError),
    (load_references, ReferenceFileError),
    (load_map, MapFileError),
    (read_occupancy_grid, OccupancyGridError),
    (read_pose_graph, PoseGraphError),
    (read_tum, TrajectoryError),
    (looks_like_references, OSError),
    (looks_like_map, OSError),
]


@pytest.fixture(params=["pipe", "/dev/zero", "/dev/null"])
def no_file(request, tmp_path):
    """A pipe that nobody writes to, or a device."""
    path = tmp_path / request.param
    if request.param == "pipe":
        os.mkfifo(path)
    return path


@pytest.mark.parametrize(("read", "error"), READERS)
def test_a_pipe_or_device_is_refused_before_it_is_opened(no_file, read, error):
    with pytest.raises(error, match="a pipe or device is not read; write it to a file first"):
        read(no_file)


@pytest.mark.parametrize(("read", "error"), READERS)
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("a\0b", "no file has such a name"),
        ("\ud800", "no file has such a name"),
        ("a" * 300, "File name too long"),
    ],
)
def test_a_name_that_no_file_can_have_is_refused_as_any_file_is(read, error, name, reason):
    with pytest.raises(error, match=reason):
        read(name)


def test_a_link_to_a_file_is_one(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "file")
    check_file(tmp_path / "link")


def test_little_may_be_packed_tighter_than_much():
    assert most_unpacked(0) == most_unpacked(1 << 19) == 1 << 26
    assert most_unpacked(1 << 30) == 100 << 30
