"""What a process needs that has just begun: `python -m benchmarks.fresh WHAT [CACHE]`.

Prints seconds. WHAT is `import`, of aprjax once jax is there; `build`, of a set of 30 references;
or `match`, of the first scan with them. CACHE is a folder for compiled programs. Run by `seconds`,
each time in a process of its own.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import jax

ROOT = Path(__file__).resolve().parents[1]
SPLIT, REFERENCES = "intel.interleaved", 30


def seconds(what: str, cache: Path | None = None) -> float:
    """What one fresh process measures. Raises `RuntimeError` with its last words if it fails."""
    environment = dict(os.environ)
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    command = [sys.executable, "-m", "benchmarks.fresh", what, *([str(cache)] if cache else [])]
    run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if run.returncode != 0:
        raise RuntimeError((run.stderr.strip() or "no message").splitlines()[-1])
    return float(run.stdout)


def _measured(what: str, cache: str | None) -> float:
    began = time.perf_counter()
    import aprjax

    if what == "import":
        return time.perf_counter() - began

    from benchmarks.inputs import some, split

    if cache is not None:
        aprjax.cache_compilations(cache)
    scans = split(SPLIT)
    began = time.perf_counter()
    references = aprjax.ReferenceSet.build(some(scans.references, slice(REFERENCES)))
    jax.block_until_ready(references.index.features.view.xy)
    if what == "match":
        began = time.perf_counter()
        jax.block_until_ready(aprjax.match(some(scans.queries, 0), references).quality)
    return time.perf_counter() - began


if __name__ == "__main__":
    print(_measured(sys.argv[1], *(sys.argv[2:] or [None])))
