import os
import tomllib
from pathlib import Path

import jax
import pytest

from aprjax.cli import info
from aprjax.cli.outputs import shown_path
from aprjax.programs import keep_traces

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Where the cache would be, with the process's own setting restored afterwards."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = jax.config.jax_compilation_cache_dir
    yield tmp_path / "aprjax"
    keep_traces(None)
    jax.config.update("jax_compilation_cache_dir", before)


def test_compiled_programs_are_kept_only_when_asked(cache, command, logs):
    assert command("info", logs[0])[0] == 0
    assert not cache.exists()
    assert command("--cache", "info", logs[0])[0] == 0
    assert cache.is_dir()


def test_a_cache_that_others_can_write_to_is_one_clear_line(cache, command, logs):
    cache.mkdir(mode=0o777)
    cache.chmod(0o777)
    status, out, err = command("--cache", "info", logs[0])
    assert (status, out) == (1, "")
    assert err == f"aprjax: {cache}: others can write to it; cached programs are executed\n"


def test_the_version_is_that_of_the_project(command):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    status, out, err = command("--version")
    assert (status, err) == (0, "")
    assert out in (f"aprjax {project['version']}\n", "aprjax of a checkout that is not installed\n")


def test_what_nothing_had_refused_is_one_line_too(command, logs, monkeypatch):
    def fail(_):
        raise ValueError("no reader\nsaw this")

    monkeypatch.setattr(info, "run", fail)
    assert command("info", logs[0]) == (1, "", "aprjax: ValueError: no reader saw this\n")


def test_names_that_are_not_unicode_are_shown_and_written(command, tmp_path):
    name = os.fsdecode(b"\xff.log.gz")
    assert shown_path(tmp_path / name).endswith("\ufffd.log.gz")
    status, _, err = command("info", tmp_path / name)
    assert status == 1
    assert "No such file" in err
