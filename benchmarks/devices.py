"""How matching scales with devices: `python -m benchmarks devices`.

Strong scaling: the same references on more and more devices. Weak scaling: as many references on
each, so that a perfect machine needs the same time. On a CPU the devices are virtual, and share the
cores: beyond as many devices as cores nothing can be gained.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fresh import ROOT
from benchmarks.report import text
from experiments.outputs import write_table

COUNTS = (1, 2, 4, 8)
REFERENCES = 2048
"""With strong scaling on all devices together, with weak scaling on all of `COUNTS[-1]`."""
QUERIES, REPEATS = 32, 5


def run(quick: bool, out: Path | None) -> int:
    """Print the table and write it to `out`; the exit code."""
    table: list[dict[str, Any]] = []
    for devices in COUNTS[:2] if quick else COUNTS:
        for kind, references in (
            ("strong", REFERENCES),
            ("weak", REFERENCES // COUNTS[-1] * devices),
        ):
            measured = _in_a_process(devices, references)
            if "skipped" in measured:
                print(measured["skipped"], file=sys.stderr)
                continue
            table.append({"scaling": kind, "devices": devices, "references": references} | measured)
    if not table:
        return 1
    print(text(table), end="")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_table(table, out / "devices.csv")
    return 0


def _in_a_process(devices: int, references: int) -> dict[str, Any]:
    """Measured by a process of its own, since the number of virtual devices is fixed in one."""
    flag = f"--xla_force_host_platform_device_count={devices}"
    environment = os.environ | {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flag}"}
    command = [sys.executable, "-m", "benchmarks.devices", str(devices), str(references)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        return {"skipped": f"{devices} devices: {last}"}
    return json.loads(done.stdout)


def _measured(devices: int, references: int) -> dict[str, Any]:
    import jax

    import aprjax
    from benchmarks.inputs import some, split
    from benchmarks.timing import timed
    from benchmarks.workload import Skipped

    if len(jax.devices()) < devices:
        raise SystemExit(f"there are only {len(jax.devices())}")
    try:
        scans = split("intel.interleaved")
    except Skipped as reason:
        return {"skipped": str(reason)}
    # The log has not so many scans: some are there several times, which takes as long.
    rows = np.arange(references) % len(scans.references.ranges)
    known = jax.tree.map(lambda array: np.asarray(array)[rows], scans.references)
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:devices]), ("references",))
    spread = aprjax.ShardedReferences.build(known, mesh)
    queries = some(scans.queries, slice(QUERIES))
    seconds = timed(lambda _: aprjax.match_sharded(queries, spread).quality, REPEATS)
    return {"ms a query": round(1e3 * float(np.median(seconds)) / QUERIES, 2)}


if __name__ == "__main__":
    print(json.dumps(_measured(*map(int, sys.argv[1:]))))
