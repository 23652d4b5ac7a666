import os
import socket
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from aprjax import MatchConfig, ReferenceSet, Scan, ShardedReferences, match_sharded
from tests.worlds import free_pose, office, scan_at

ROOT = Path(__file__).parents[2]
PROCESSES, DEVICES = 2, 4


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What each of two processes on loopback, with four devices each, found."""
    folder = tmp_path_factory.mktemp("sharding")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {
        **os.environ,
        "JAX_PLATFORMS": "cpu",
        # Without optimisation, programs compile in a fraction of the time.
        "XLA_FLAGS": f"--xla_force_host_platform_device_count={DEVICES} "
        "--xla_backend_optimization_level=0",
    }
    outs = [folder / f"{number}.npz" for number in range(PROCESSES)]
    command = [sys.executable, "-m", "tests.sharding.process"]
    running = [
        subprocess.Popen(
            [*command, str(number), str(PROCESSES), str(port), str(out)],
            cwd=ROOT,
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number, out in enumerate(outs)
    ]
    try:
        messages = [process.communicate(timeout=400)[1] for process in running]
    finally:
        for process in running:
            process.kill()
    assert [process.returncode for process in running] == [0] * PROCESSES, "\n".join(messages)
    return [dict(np.load(out)) for out in outs]


def test_eight_devices_of_two_processes_find_what_one_device_finds(found):
    first = found[0]
    assert first["devices"] == PROCESSES * DEVICES
    names = [name.removeprefix("single") for name in first if name.startswith("single")]
    assert ".reference" in names
    for name in names:
        single, sharded = first["single" + name], first["sharded" + name]
        assert single.dtype == sharded.dtype
        if np.issubdtype(single.dtype, np.floating):
            np.testing.assert_allclose(sharded, single, atol=2e-4, err_msg=name)
        else:
            np.testing.assert_array_equal(sharded, single, err_msg=name)
    assert np.sum(first["single.confident"]) > 3
    assert set(first["single.reference"][:, 0]) & set(range(18, 24))


def test_every_process_gets_the_same_result_to_the_bit(found):
    first, second = found
    assert {name for name in first if name.startswith("sharded")} == set(second)
    for name in second:
        np.testing.assert_array_equal(second[name], first[name])


@pytest.fixture(scope="module")
def scans():
    rng, world = np.random.default_rng(5), office(seed=3)
    return [scan_at(world, free_pose(world, rng)) for _ in range(3)]


@pytest.fixture(scope="module")
def mesh():
    return jax.sharding.Mesh(np.array(jax.devices()[:1]), ("references",))


def test_the_index_on_one_device_is_that_of_a_reference_set(scans, mesh):
    spread, single = ShardedReferences.build(scans, mesh), ReferenceSet.build(scans)
    leaves = zip(jax.tree.leaves(spread.index), jax.tree.leaves(single.index), strict=True)
    for sharded, whole in leaves:
        np.testing.assert_array_equal(sharded[0], whole)


def test_growing_and_shrinking_give_ids_as_in_a_reference_set(scans, mesh):
    spread = ShardedReferences.build(scans, mesh).add(scans[:2]).remove([1, 3])
    np.testing.assert_array_equal(spread.ids, [0, 2, 4])
    assert len(spread) == 3
    assert spread.next_id == 5
    np.testing.assert_array_equal(spread.add(scans[:1]).ids, [0, 2, 4, 5])


def test_what_references_were_built_from_may_change_and_they_do_not(scans, mesh):
    stack = Scan.stack(scans)
    spread = ShardedReferences.build(stack, mesh)
    stack.ranges[:] = 7
    np.testing.assert_array_equal(spread.scans.ranges[1, :181], scans[1].ranges)


def test_bad_requests_are_refused_by_name(scans, mesh):
    spread = ShardedReferences.build(scans, mesh)
    with pytest.raises(ValueError, match=r"ids\[1\]: no reference has id 9"):
        spread.remove([0, 9])
    with pytest.raises(ValueError, match="scans: 0 of them are fewer than the 1 devices"):
        spread.remove([0, 1, 2])
    with pytest.raises(ValueError, match="T_world_ref"):
        ShardedReferences.build(scans, mesh, T_world_ref=np.zeros((2, 3)))
    with pytest.raises(ValueError, match="cascade"):
        match_sharded(scans, spread, MatchConfig(cascade=False))
    square = jax.sharding.Mesh(np.array(jax.devices()[:1]).reshape(1, 1), ("a", "b"))
    with pytest.raises(ValueError, match="mesh: axes"):
        ShardedReferences.build(scans, square)
