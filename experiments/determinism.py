"""Every command twice, in processes of their own: identical files, measured times apart.

    python -m experiments.determinism --out DIR [COMMAND ...]

The first run of a command compiles, the second takes what the first has compiled. What a command
prints is compared as its files are, bit by bit: tables, maps, pages, PNG and GIF. Times stand in
`times.csv` of a sweep and in the rows of `demo` that say so, and are left out. Prints and writes
`determinism.csv`, and writes `configuration.json` and, in folders, what was compared, into DIR.
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

from experiments.outputs import print_table, write_configuration, write_table

_SWEEP = ("--set", "congruence.tolerance=0.04:0.08:2", "--set", "voting.length=0.06:0.12:2")


def commands(inputs: Path) -> dict[str, tuple[str, ...]]:
    """The words of each command; `{out}` is a folder for what it writes."""
    references, second = (str(inputs / f"{name}.log.gz") for name in ("references", "second"))
    world = str(inputs / "world.map")
    return {
        "simulate": ("simulate", "--references", "5", "--scans", "40", "--out", "{out}"),
        "info": ("info", second),
        "match": (
            *("match", references, second, "--out", "{out}/m.csv"),
            *("--save-references", "{out}/r.npz"),
        ),
        "match itself": ("match", second, second, "--exclude-self", "--out", "{out}/m.csv"),
        "explain": ("explain", references, second, "--query", "5", "--out", "{out}/e.html"),
        "sweep": ("sweep", references, second, *_SWEEP, "--out", "{out}"),
        "map build": ("map", "build", second, "--out", "{out}/m.map"),
        "map info": ("map", "info", world, "--json"),
        "map show": ("map", "show", world, "--relaxed", "--out", "{out}/m.png"),
        "map path": ("map", "path", world, "0", "2"),
        "map export": ("map", "export", world, "--out", "{out}/m.json"),
        "map export g2o": ("map", "export", world, "--out", "{out}/m.g2o"),
        "localize": (
            *("localize", world, second, "--out", "{out}/l.csv", "--tum", "{out}/l.tum"),
            *("--pictures", "{out}/pictures", "--cycles", "1,32", "--gif", "{out}/l.gif"),
        ),
        "demo": ("demo", "--scans", "40", "--resolution", "1", "--out", "{out}"),
    }


def run(words: tuple[str, ...], out: Path, cache: Path) -> dict[str, bytes]:
    """What a command writes and prints, without measured times."""
    out.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "aprjax.cli.main", "--cache", *(w.format(out=out) for w in words)],
        capture_output=True, check=False,
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.decode(errors='replace').strip()}")
    files = {
        str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()
    }
    found = files | {"standard output": done.stdout}
    return {name: timeless(words[0], name, data) for name, data in found.items()}


def timeless(command: str, name: str, data: bytes) -> bytes:
    """The bytes of a file without the times that were measured."""
    if command == "sweep" and name == "times.csv":
        return b""
    if command == "demo" and name == "standard output":
        # Columns are as wide as their times.
        lines = [line for line in data.splitlines() if b"time" not in line]
        return b"\n".join(re.sub(b"[ -]+", b" ", line) for line in lines)
    if command == "demo" and name == "table.csv":
        lines = [line.split(b",") for line in data.splitlines()]
        kept = [k for k, title in enumerate(lines[0]) if not title.endswith(b"_ms")]
        return b"\n".join(b",".join(line[k] for k in kept) for line in lines)
    return data


def differing(first: dict[str, bytes], second: dict[str, bytes]) -> list[str]:
    """Names of what is not the same in both."""
    names = sorted(first.keys() | second.keys())
    return [name for name in names if first.get(name) != second.get(name)]


def main() -> int:
    """Run all; the exit status says whether anything differed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commands", nargs="*", metavar="COMMAND")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    arguments = parser.parse_args()
    folder = arguments.out.resolve()
    inputs, cache = folder / "inputs", folder / "cache"
    known = commands(inputs)
    for name in arguments.commands:
        if name not in known:
            parser.error(f"{name!r} is none of {', '.join(known)}")
    chosen = arguments.commands or list(known)
    scans = ("--references", "8", "--scans", "160", "--resolution", "1")
    run(("simulate", *scans, "--out", "{out}"), inputs, cache)
    world = inputs / "world.map"
    if any(str(world) in known[name] for name in chosen):
        build = ("map", "build", str(inputs / "second.log.gz"), "--out", "{out}/world.map")
        run(build, folder / "built", cache)
        (folder / "built" / "world.map").rename(world)
    rows, status = [], 0
    for name in chosen:
        at = name.replace(" ", "-")
        first, second = (run(known[name], folder / at / turn, cache) for turn in ("1", "2"))
        off = differing(first, second)
        status |= bool(off)
        size = sum(map(len, first.values()))
        row = {"command": name, "files": len(first) - 1, "bytes": size, "differing": len(off)}
        rows.append(row)
        print_table(rows[-1:])
        for each in off:
            print(f"{name}: {each} differs", file=sys.stderr)
        write_table(rows, folder / "determinism.csv")
    write_configuration(folder, commands=chosen)
    return status


if __name__ == "__main__":
    sys.exit(main())
