import resource
from contextlib import contextmanager

import pytest

from aprjax.cli import progress
from aprjax.cli.main import main
from tests.make_logs import write_logs


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Paths of a log of 8 references and one of 20 queries near them."""
    return write_logs(tmp_path_factory.mktemp("logs"))


@pytest.fixture
def command(capsys, request, monkeypatch):
    """Runs a command and returns its exit status, standard output and standard error.

    Without the lines of progress, which come when it takes long.
    """
    monkeypatch.setattr(progress, "_SILENCE", float("inf"))
    limit = 200 if "full_disk" in request.fixturenames else None

    def run(*words):
        with _no_file_past(limit):
            try:
                status = main([str(word) for word in words])
            except SystemExit as stop:
                status = stop.code
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def full_disk():
    """While `command` runs, no file can grow past a few bytes, as on a disk that is full."""


@contextmanager
def _no_file_past(size):
    """Limits the length of every file that this process writes; pytest's own report is one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
