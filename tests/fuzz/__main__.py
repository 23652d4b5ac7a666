"""Fuzz a reader: `python -m tests.fuzz TARGET [--seconds N]`.

Guided by coverage where atheris can be imported (`pip install atheris`), else by blind changes.
An input that breaks a reader is written beside the kept cases, which the tests read.
"""

import argparse
import hashlib
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

try:
    import atheris
except ImportError:
    atheris = None
if atheris is not None:
    with atheris.instrument_imports(include=["aprjax.io", "aprjax.world.store", "rosbags"]):
        from tests.fuzz.targets import CASES, TARGETS, cases
else:
    from tests.fuzz.targets import CASES, TARGETS, cases
from tests.fuzz.mutate import mutated

_LONGEST = 1 << 14  # bytes of an input
_MEBIBYTES, _TIMEOUT = 1024, 60  # more memory, and seconds, which no input may take


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=600)
    arguments = parser.parse_args()
    name, target = arguments.target, TARGETS[arguments.target]
    with tempfile.TemporaryDirectory() as temporary:
        folder, corpus = Path(temporary) / "file", Path(temporary) / "corpus"
        folder.mkdir()
        corpus.mkdir()
        seeds = [*target.seeds(Path(temporary)), *cases(name)]
        for number, data in enumerate(seeds):
            (corpus / str(number)).write_bytes(data)

        def one(data: bytes) -> None:
            before = _most_memory()
            try:
                target.check(data, folder)
                more = _most_memory() - before
                assert more < _MEBIBYTES, f"{more:.0f} MiB more than any input before"
            except Exception:
                kept = CASES / name / hashlib.sha256(data).hexdigest()[:16]
                kept.parent.mkdir(exist_ok=True)
                kept.write_bytes(data)
                print(f"breaks the reader: {kept}", file=sys.stderr)
                raise

        if atheris is None:
            _blind(one, seeds, arguments.seconds)
            return
        options = [
            f"-max_total_time={arguments.seconds}",
            f"-max_len={max(_LONGEST, *map(len, seeds))}",
            "-len_control=0",
            # The fuzzer itself keeps some 50 KiB of every input.
            "-rss_limit_mb=0",
            f"-timeout={_TIMEOUT}",
            f"-report_slow_units={_TIMEOUT}",
            f"-artifact_prefix={CASES / name}-",
            str(corpus),
        ]
        atheris.Setup([sys.argv[0], *options], one)
        atheris.Fuzz()


def _most_memory() -> float:
    """The most that this process ever had, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _blind(one, seeds: list[bytes], seconds: int) -> None:
    rng, stop, count = np.random.default_rng(), time.monotonic() + seconds, 0
    while time.monotonic() < stop:
        one(mutated(seeds[rng.integers(len(seeds))], rng))
        count += 1
    print(f"{count} inputs", file=sys.stderr)


if __name__ == "__main__":
    main()
