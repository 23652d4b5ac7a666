"""Baselines, and whether something has become slower than its own."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from aprjax.atomic import atomic_write
from benchmarks.workload import Figure


class BaselineError(Exception):
    """A baseline that cannot be used, in one line."""


@dataclass(frozen=True)
class Baseline:
    """Figures of an earlier run."""

    machine: str
    platform: str
    """JAX's name of the backend: times of a CPU say nothing about a GPU."""
    figures: tuple[Figure, ...]


def write_baseline(baseline: Baseline, path: Path) -> None:
    """As JSON, completely or not at all."""
    with atomic_write(path) as file:
        json.dump(dataclasses.asdict(baseline), file, indent=1, ensure_ascii=False)
        file.write("\n")


def read_baseline(path: Path) -> Baseline:
    """What `write_baseline` wrote. Raises `BaselineError` for a file that it did not write."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        figures = tuple(Figure(**figure) for figure in values["figures"])
        return Baseline(values["machine"], values["platform"], figures)
    except OSError as error:
        raise BaselineError(f"{path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise BaselineError(f"{path}: not a baseline ({error!r})") from None


def complaints(
    measured: list[Figure], baseline: Baseline, selected: set[str], platform: str
) -> list[str]:
    """What speaks against the run, one line each; none if it passes.

    A figure fails when, normalised, it is above its baseline by more than the tolerance that the
    workload has now. A selected workload of the baseline that was not measured fails too, and so
    does a run of which nothing could be compared. Figures that the baseline lacks are let pass.
    """
    if baseline.platform != platform:
        return [f"the baseline was measured on {baseline.platform}, and this is {platform}"]
    found = {figure.name: figure for figure in measured}
    expected = [figure for figure in baseline.figures if figure.workload in selected]
    if not expected:
        return ["the baseline has none of the selected workloads"]
    lines = []
    for before in expected:
        now = found.get(before.name)
        if now is None:
            lines.append(f"{before.name}: not measured")
        elif now.unit != before.unit:
            lines.append(f"{now.name}: measured in {now.unit}, the baseline in {before.unit}")
        elif not now.normalised <= before.normalised * (1 + now.tolerance):
            lines.append(
                f"{now.name}: {now.normalised:.4g} {now.unit} (normalised) is "
                f"{now.normalised / before.normalised - 1:+.0%} from the baseline's "
                f"{before.normalised:.4g}, and {now.tolerance:.0%} is allowed"
            )
    return lines
