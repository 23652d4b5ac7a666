"""Times of aprjax: `python -m benchmarks [NAME ...]`.

Measures the named workloads (`--list`; wildcards as in `batch.*`), all of them by default, after
warm-up. Less is better throughout. Beside every value stand the 10th and 90th percentile of its
samples and the `normalised` value, which is divided by how slow the machine was just before and
after: `benchmarks.machine` does work that has nothing to do with aprjax, in plain NumPy and in
jitted JAX, and a machine that takes 10 ms for each has slowness 1. Workloads whose data are
missing are skipped with the reason.

`python -m benchmarks stages` prints the time of each stage of the matcher instead, with the
arithmetic and the bytes that the compiler counts; `python -m benchmarks devices` how the time
depends on the number of devices that references are spread over.
"""

import argparse
import fnmatch
import sys
from collections.abc import Sequence
from pathlib import Path

import jax

from benchmarks import devices, stages
from benchmarks.gate import Baseline, BaselineError, complaints, read_baseline, write_baseline
from benchmarks.machine import machine_name, probe
from benchmarks.report import draw, rows, text
from benchmarks.workload import Figure, Skipped, Workload, figures
from benchmarks.workloads import WORKLOADS
from experiments.outputs import write_figure, write_table

BASELINE = Path(__file__).parent / "results" / "baseline.json"


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, write; the exit code."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.list:
        print(
            text([{"workload": w.name, "unit": w.unit, "what": w.what} for w in WORKLOADS]), end=""
        )
        return 0
    for name, table in (("stages", stages), ("devices", devices)):
        if chosen.names == [name]:
            return table.run(chosen.quick, chosen.out)
    selected = [w for w in WORKLOADS if any(fnmatch.fnmatch(w.name, n) for n in chosen.names)]
    for name in chosen.names:
        if not fnmatch.filter([w.name for w in WORKLOADS], name):
            parser.error(f"{name}: no workload has this name; see --list")
    if chosen.write_baseline and len(selected) < len(WORKLOADS):
        parser.error("--write-baseline: a baseline holds all workloads; leave the names out")
    try:
        baseline = read_baseline(chosen.gate) if chosen.gate else None
    except BaselineError as error:
        print(error, file=sys.stderr)
        return 2

    name, platform = machine_name(), jax.default_backend()
    print(name, file=sys.stderr)
    measured, skipped, failed = measure(selected, chosen.quick)
    table = rows(measured)
    print(text(table), end="")
    for workload, reason in skipped.items():
        print(f"{workload}: skipped: {reason}")
    for workload, reason in failed.items():
        print(f"{workload}: failed: {reason}")
    if chosen.out and measured:
        chosen.out.mkdir(parents=True, exist_ok=True)
        write_table(table, chosen.out / "benchmarks.csv")
        (chosen.out / "benchmarks.txt").write_text(f"{name}\n\n{text(table)}", encoding="utf-8")
        write_figure(draw(measured, name), chosen.out / "benchmarks.png")
    if chosen.write_baseline:
        if skipped or failed:
            print("no baseline is written: some workloads were not measured", file=sys.stderr)
            return 1
        write_baseline(Baseline(name, platform, tuple(measured)), BASELINE)
    lines: list[str] = []
    if baseline:
        lines = complaints(measured, baseline, {w.name for w in selected}, platform)
        for line in lines:
            print(f"gate: {line}", file=sys.stderr)
    return 1 if failed or lines else 0


def measure(
    workloads: Sequence[Workload], quick: bool
) -> tuple[list[Figure], dict[str, str], dict[str, str]]:
    """The figures, and why workloads were skipped or failed."""
    found: list[Figure] = []
    skipped: dict[str, str] = {}
    failed: dict[str, str] = {}
    before = probe()
    for workload in workloads:
        print(f"{workload.name} …", file=sys.stderr, flush=True)
        try:
            samples = workload.measure(quick)
        except Skipped as reason:
            skipped[workload.name] = str(reason)
            continue
        except RuntimeError as reason:
            failed[workload.name] = str(reason)
            continue
        after = probe()
        for figure in figures(workload, samples, [before, after]):
            print(f"    {figure.value:.4g} {figure.unit}, {figure.metric}", file=sys.stderr)
            found.append(figure)
        before = after
    return found, skipped, failed


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names", nargs="*", default=["*"], metavar="NAME", help="or one of `stages` and `devices`"
    )
    parser.add_argument("--list", action="store_true", help="name the workloads and measure none")
    parser.add_argument("--quick", action="store_true", help="fewer repeats of the same work")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write table and plot there")
    parser.add_argument(
        "--gate",
        type=Path,
        metavar="BASELINE",
        help="exit 1 if a workload is slower than in this file by more than its tolerance",
    )
    parser.add_argument(
        "--write-baseline", action="store_true", help="to benchmarks/results/baseline.json"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
