"""One of several processes: `python -m tests.sharding.process NUMBER PROCESSES PORT OUT`.

Matches with references on one device, then on all devices of all processes; writes both to OUT.
"""

import sys

import jax
import numpy as np

import aprjax
from tests.worlds import free_pose, office, scan_at

CONFIG = aprjax.MatchConfig(top_k=14)


def columns(result: aprjax.MatchResult, prefix: str) -> dict[str, np.ndarray]:
    """A result as named arrays."""
    leaves = jax.tree_util.tree_leaves_with_path(result)
    return {prefix + jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}


def main() -> None:
    number, processes, port, out = sys.argv[1:]
    if int(processes) > 1:
        jax.distributed.initialize(f"127.0.0.1:{port}", int(processes), int(number))
    rng, world = np.random.default_rng(5), office(seed=3)
    poses = [free_pose(world, rng) for _ in range(36)]
    scans = [scan_at(world, pose, noise=0.01, rng=rng) for pose in poses]
    known, later, queries = scans[:18], scans[18:24], scans[24:] + scans[:3]
    T_world_ref = np.array(poses[:24])
    T_world_ref[4] = np.nan
    exclude = np.full((len(queries), 2), -1)
    exclude[-3:, 0] = range(3)

    mesh = jax.sharding.Mesh(np.array(jax.devices()), ("references",))
    spread = aprjax.ShardedReferences.build(known, mesh, T_world_ref=T_world_ref[:18])
    spread = spread.add(later, T_world_ref=T_world_ref[18:]).remove([7, 20])
    single = aprjax.ReferenceSet.build(known, T_world_ref=T_world_ref[:18])
    single = single.add(later, T_world_ref=T_world_ref[18:]).remove([7, 20])
    found = columns(aprjax.match_sharded(queries, spread, CONFIG, exclude=exclude), "sharded")
    if int(number) == 0:
        found |= columns(aprjax.match_batch(queries, single, CONFIG, exclude=exclude), "single")
        found["devices"] = np.asarray(len(jax.devices()))
    np.savez(out, **found)


if __name__ == "__main__":
    main()
