"""What importing aprjax does to a process, and what it leaves undone."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = """
import json, sys
import jax
from jax._src import xla_bridge

before = dict(jax.config.values)
import aprjax
changed = [name for name, value in jax.config.values.items() if before.get(name) != value]
print(json.dumps([changed, xla_bridge.backends_are_initialized(), sorted(sys.modules)]))
"""


@pytest.fixture(scope="module")
def imported():
    """JAX's settings that changed, whether a device was looked for, and all modules, after it."""
    command = [sys.executable, "-c", SCRIPT]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


def test_no_setting_of_jax_changes_and_no_device_is_touched(imported):
    changed, initialized, _ = imported
    assert changed == []
    assert not initialized


@pytest.mark.parametrize(
    "name", ["matplotlib", "rosbags", "scipy.sparse", "scipy.ndimage", "scipy.spatial"]
)
def test_what_only_maps_grids_bags_and_pictures_need_is_not_loaded(imported, name):
    *_, modules = imported
    assert "aprjax.world.smoothing" in modules
    assert name not in modules
