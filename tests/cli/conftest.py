import resource

import pytest

from aprjax.cli.main import main
from tests.make_logs import write_logs


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Paths of a log of 8 references and one of 20 queries near them."""
    return write_logs(tmp_path_factory.mktemp("logs"))


@pytest.fixture
def command(capsys):
    """Runs a command and returns its exit status, standard output and standard error."""

    def run(*words):
        try:
            status = main([str(word) for word in words])
        except SystemExit as stop:
            status = stop.code
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def full_disk():
    """No file can grow past a few bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
