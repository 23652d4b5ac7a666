"""Commands killed at random moments: what they had written stays, and nothing is half written.

    python -m experiments.kills --out DIR [--kills N] [--seed N] [COMMAND ...]

Simulates two runs, carries out each command (`match`, `exhaustive` for every scan of a run against
every other, `build` for `map build`, `localize`, `sweep`) twice as a whole, and then kills N runs
of it (SIGKILL, which no program can catch): every other one at any moment, the others once it has
begun to write. After each kill no file may carry a final name unless it is the whole run's, bit by
bit; no finished piece of `match` and `sweep` may be gone or differ. In the end the command must
come to the same files again, measured times apart.
Prints and writes `kills.csv`, and writes `configuration.json`, into DIR, where the runs lie too.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from aprjax.io.archive import ArchiveError, read_archive
from experiments.outputs import print_table, write_configuration, write_table

_POLL = 2e-4  # seconds between two looks at what is written
COMMANDS = ("match", "exhaustive", "build", "localize", "sweep")
_TIMES = "times.csv"  # of a sweep: no two runs share them
_LAST = "manifest.json"  # what a sweep writes when all else is there


@dataclass
class Outcome:
    """What kills of one command led to."""

    command: str
    kills: int = 0
    while_writing: int = 0
    """Of them, those that left a temporary file."""
    finished: int = 0
    """Runs that ended before they were killed."""
    pieces_kept: int = 0
    """Finished pieces that were there after a kill, summed up."""
    broken: list[str] = field(default_factory=list)


def words(command: str, folder: Path, out: Path) -> list[str]:
    """The command line that writes `out`."""
    runs = {name: str(folder / f"{name}.log.gz") for name in ("references", "first", "second")}
    if command == "match":
        rest = ["match", runs["references"], runs["second"]]
    elif command == "exhaustive":
        rest = ["match", runs["second"], runs["second"], "--exclude-self"]
    elif command == "build":
        rest = ["map", "build", runs["second"]]
    elif command == "sweep":
        # The poses that score are odometry's, which no answer depends on.
        rest = ["sweep", runs["references"], runs["second"]]
        rest += ["--set", "congruence.tolerance=0.04:0.08:2", "--set", "voting.length=0.06:0.12:4"]
    else:
        rest = ["localize", str(folder / "whole.build"), runs["first"]]
    return [sys.executable, "-m", "aprjax.cli.main", "--cache", *rest, "--out", str(out)]


def environment(folder: Path) -> dict[str, str]:
    """Compilations of all runs are kept in one folder."""
    return os.environ | {"XDG_CACHE_HOME": str(folder / "cache")}


def results(out: Path) -> dict[str, bytes]:
    """What carries a final name, measured times apart."""
    files = out.iterdir() if out.is_dir() else [out]
    final = (path for path in files if path.is_file() and path.suffix != ".tmp")
    return {path.name: path.read_bytes() for path in final if path.name != _TIMES}


def complete(out: Path) -> bool:
    """Whether all of it is written."""
    return out.is_file() or (out / _LAST).exists()


def pieces_of(out: Path) -> Path:
    """The folder of the finished pieces of a command that writes `out`."""
    beside = out.with_name(f"{out.name}.pieces")
    return beside if beside.exists() else out / "pieces"


def remove(out: Path) -> None:
    """Remove a file or a folder."""
    if out.is_dir():
        shutil.rmtree(out)
    else:
        out.unlink()


def run(command: str, folder: Path, out: Path) -> dict[str, bytes]:
    """What the command writes when left alone."""
    subprocess.run(
        words(command, folder, out), check=True, env=environment(folder), capture_output=True
    )
    return results(out)


def whole(command: str, folder: Path) -> tuple[dict[str, bytes], float]:
    """What the command writes, and the seconds that it takes once compiled."""
    out = folder / f"whole.{command}"
    first = run(command, folder, out)
    remove(out)
    start = time.monotonic()
    second = run(command, folder, out)
    if first != second:
        raise AssertionError(f"{command}: two runs differ")
    return second, time.monotonic() - start


def killed(
    command: str, folder: Path, kills: int, expected: dict[str, bytes], seconds: float, seed: int
) -> Outcome:
    """The outcome of so many kills."""
    rng, outcome = np.random.default_rng(seed), Outcome(command)
    here = folder / f"killed-{command}"
    here.mkdir(exist_ok=True)
    out = here / f"whole.{command}"
    pieces: dict[str, bytes] = {}
    for number in count():
        if outcome.kills == kills:
            break
        if number % 2:
            finished = _kill_while_writing(words(command, folder, out), folder, out, rng)
        else:
            moment = rng.uniform(0, seconds)
            finished = _kill_after(words(command, folder, out), folder, moment)
        outcome.kills += not finished
        outcome.finished += finished
        left = list(here.rglob(".*.tmp"))
        outcome.while_writing += bool(left)
        for path in left:
            path.unlink()
        if out.exists():
            for name, data in results(out).items():
                if expected.get(name) != data:
                    outcome.broken.append(f"{number}: another file under the final name {name}")
        kept = pieces_of(out)
        now = {path.name: path.read_bytes() for path in sorted(kept.glob("*.npz"))}
        outcome.pieces_kept += len(now)
        for name in now:
            try:
                read_archive(kept / name, "piece")
            except ArchiveError as error:
                outcome.broken.append(f"{number}: piece {name}: {error}")
        if complete(out):
            # Pieces go when all is written, one after the other.
            remove(out)
            pieces = {}
            continue
        for name, data in pieces.items():
            if now.get(name) != data:
                outcome.broken.append(f"{number}: piece {name} was lost")
        pieces = now
    if run(command, folder, out) != expected:
        outcome.broken.append("the run after all kills wrote something else")
    if pieces_of(out).exists():
        outcome.broken.append("the run after all kills left its pieces")
    return outcome


def _started(line: list[str], folder: Path) -> subprocess.Popen:
    silent = subprocess.DEVNULL
    return subprocess.Popen(line, env=environment(folder), stdout=silent, stderr=silent)


def _kill_after(line: list[str], folder: Path, seconds: float) -> bool:
    """Whether the run was quicker."""
    with _started(line, folder) as process:
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            return False
    return True


def _kill_while_writing(line: list[str], folder: Path, out: Path, rng: np.random.Generator) -> bool:
    """Kill a run within a few milliseconds of one of the files that it begins to write."""
    files, delay = rng.integers(1, 5), rng.uniform(0, 4e-3)
    seen: set[Path] = set()
    with _started(line, folder) as process:
        while process.poll() is None:
            seen.update(out.parent.rglob(".*.tmp"))
            # A command that writes one file is killed at that.
            if len(seen) >= files or (seen and not pieces_of(out).exists()):
                time.sleep(delay)
                process.kill()
                return False
            time.sleep(_POLL)
    return True


def main() -> int:
    """Run all; the exit status says whether anything was lost."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=", ".join(COMMANDS))
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--kills", type=int, default=50, metavar="N", help="of each command")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    arguments = parser.parse_args()
    for command in arguments.commands:
        if command not in COMMANDS:
            parser.error(f"{command!r} is none of {', '.join(COMMANDS)}")
    chosen = arguments.commands or COMMANDS
    folder = arguments.out
    simulate = ("simulate", "--references", "8", "--scans", "160", "--resolution", "1")
    subprocess.run(
        [sys.executable, "-m", "aprjax.cli.main", *simulate, "--out", str(folder)],
        check=True, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    rows, broken = [], []
    for command in chosen:
        if command == "localize" and not (folder / "whole.build").exists():
            run("build", folder, folder / "whole.build")
        expected, seconds = whole(command, folder)
        print(f"{command}: {seconds:.1f} s as a whole", file=sys.stderr, flush=True)
        outcome = killed(command, folder, arguments.kills, expected, seconds, arguments.seed)
        rows.append(
            {
                "command": command,
                "kills": outcome.kills,
                "while_writing": outcome.while_writing,
                "finished_before": outcome.finished,
                "pieces_kept": outcome.pieces_kept,
                "broken": len(outcome.broken),
            }
        )
        broken += [f"{command} {line}" for line in outcome.broken]
        print_table(rows[-1:])
        write_table(rows, folder / "kills.csv")
    write_configuration(folder, commands=chosen, kills=arguments.kills, seed=arguments.seed)
    for line in broken:
        print(line, file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
