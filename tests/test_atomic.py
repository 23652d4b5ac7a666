import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aprjax.atomic import atomic_write


def test_text_and_bytes_arrive_as_written(tmp_path):
    with atomic_write(tmp_path / "text") as file:
        file.write("π\r\n")
    with atomic_write(str(tmp_path / "bytes"), "wb") as file:
        file.write(b"\x00\xff")
    assert (tmp_path / "text").read_bytes() == "π\r\n".encode()
    assert (tmp_path / "bytes").read_bytes() == b"\x00\xff"


def test_the_old_file_stays_until_the_block_ends(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")
    with atomic_write(path) as file:
        file.write("new")
        file.flush()
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path, error):
    path = tmp_path / "table.csv"
    path.write_text("old")
    with pytest.raises(error), atomic_write(path) as file:
        file.write("half")
        raise error
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "file") as file:
            file.write("x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_a_symbolic_link_keeps_its_target(tmp_path):
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with atomic_write(tmp_path / "link") as file:
        file.write("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


def test_a_device_is_written_to_not_replaced():
    with atomic_write("/dev/null") as file:
        file.write("x")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


@pytest.mark.parametrize("name", ["missing/file", "."])
def test_a_missing_folder_or_a_folder_itself_is_an_os_error(tmp_path, name):
    with pytest.raises(OSError), atomic_write(tmp_path / name) as file:
        file.write("x")
    assert not list(tmp_path.iterdir())


def test_an_error_names_the_file_that_was_to_be_written(tmp_path):
    with pytest.raises(OSError) as caught, atomic_write("/dev/full") as file:
        file.write("x")
    assert caught.value.filename == "/dev/full"
    assert str(caught.value) == "[Errno 28] No space left on device: '/dev/full'"
    path = tmp_path / "missing" / "file"
    with pytest.raises(FileNotFoundError) as caught, atomic_write(path):
        pass
    assert caught.value.filename == str(path)


_WRITER = """
import itertools, sys
from aprjax.atomic import atomic_write
for number in itertools.count():
    with atomic_write(sys.argv[1], "wb") as file:
        for _ in range(64):
            file.write(b"%08d" % number * 4096)
    print(number, flush=True)
"""


def test_a_process_killed_at_any_moment_leaves_a_whole_file_no_older_than_it_said(tmp_path):
    path, root = tmp_path / "file", Path(__file__).resolve().parents[1]
    for number in range(2):
        with subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(path)], stdout=subprocess.PIPE, cwd=root, text=True
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(0.017 * number + 0.002)
            process.send_signal(signal.SIGKILL)
            said = int((["0", *process.stdout.read().split()])[-1])
        data = path.read_bytes()
        assert len(data) == 64 * 4096 * 8
        assert data == data[:8] * (len(data) // 8)
        assert int(data[:8]) >= said
