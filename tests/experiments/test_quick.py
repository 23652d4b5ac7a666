"""Experiments with `--quick`: what they write, and figures that a broken stage would change.

Each takes up to a minute, on a busy machine more, so they run where the environment variable
`APRJAX_EXPERIMENTS` says which: names with commas between, or `all`. Their parts are tested in the
modules beside this one.
"""

import csv
import json
import os
from typing import NamedTuple

import pytest

from experiments.__main__ import EXPERIMENTS, main

CHOSEN = os.environ.get("APRJAX_EXPERIMENTS", "").split(",")


class Within(NamedTuple):
    """A column of a table whose values lie in a range."""

    table: str
    column: str
    low: float
    high: float
    where: tuple[tuple[str, str], ...] = ()
    """What else the rows hold; all rows, if it is empty."""


class Expected(NamedTuple):
    """What an experiment writes, and figures of it."""

    files: tuple[str, ...]
    figures: tuple[Within, ...]


EVERY = (("references", "all"),)
ALL = (("split", "mean"), ("references", "all"))
IMAGES = (("sources", "defaults and images"),)
HYPOTHESES = (("method", "hypotheses"),)
WINDOW = (("setting", "features.extraction.surface.window"),)
THOUSAND = (("references", "1000"),)
EXPECTED = {
    "worked_example": Expected(
        ("configuration.json", "worked_example.png", "correspondences.csv"),
        (
            Within("worked_example.csv", "maximum", 3, 3),
            Within("worked_example.csv", "rotation_deg", 29.9, 30.1),
            Within("worked_example.csv", "wrong_in_peak", 0, 0),
            Within("worked_example.csv", "error_m", 0.0, 1e-4),
        ),
    ),
    "anchors": Expected(
        ("configuration.json", "figure1.png"),
        (
            Within("repeatability.csv", "all", 0.4, 0.7),
            Within("scans.csv", "anchors", 9.0, 15.0),
            Within("scans.csv", "jump_edge", 4.0, 7.0),
            Within("scans.csv", "angle", 3.0, 10.0),
            Within("scans.csv", "virtual_edge", 0.2, 1.0),
        ),
    ),
    "lab": Expected(
        ("map.png", "match.png"),
        (
            Within("table.csv", "correct", 35, 70, (("references aligned", "top 1"),)),
            Within("table.csv", "correct", 110, 140, (("references aligned", "all references"),)),
            Within("table.csv", "false", 0, 1),
        ),
    ),
    "real_logs": Expected(
        ("configuration.json", "times.csv", "misses.csv", "reliability.png", "map-fhw.revisit.png"),
        (
            Within("real_logs.csv", "top1", 0.9, 1.0, EVERY),
            Within("real_logs.csv", "top1", 0.05, 0.4, (("references", "1"),)),
            Within("real_logs.csv", "hits", 0.8, 1.0, EVERY),
            Within("real_logs.csv", "false", 0, 1, EVERY),
            Within("real_logs.csv", "error_m", 0.0, 0.06, EVERY),
            Within("real_logs.csv", "error_deg", 0.0, 0.6, EVERY),
        ),
    ),
    "preselection": Expected(
        ("configuration.json", "preselection.png"),
        (
            Within("preselection.csv", "first_5", 0.2, 0.5, (*ALL, ("measure", "c_m"))),
            Within("preselection.csv", "first_5", 0.25, 0.5, (*ALL, ("measure", "q_m"))),
            Within("preselection.csv", "first_5", 0.8, 1.0, (*ALL, ("measure", "votes"))),
            Within("preselection.csv", "first_5", 0.8, 1.0, (*ALL, ("measure", "signature"))),
        ),
    ),
    "million": Expected(
        ("configuration.json", "recall.png"),
        (
            Within("recall.csv", "first_64", 0.55, 0.8, (*THOUSAND, ("measure", "q_m"))),
            Within("recall.csv", "first_64", 0.9, 1.0, (*THOUSAND, ("measure", "signature"))),
        ),
    ),
    "scaling": Expected(
        ("configuration.json", "scaling.csv", "scaling.png"),
        (Within("slopes.csv", "slope", -0.2, 0.9, (("stage", "all of them"),)),),
    ),
    "all_against_all": Expected(
        ("configuration.json", "all_against_all.png", "curves.csv"),
        (
            Within("all_against_all.csv", "oracle", 0.55, 0.75),
            Within("all_against_all.csv", "quality", 0.5, 0.75),
            Within("all_against_all.csv", "anchors", 0.3, 0.5),
        ),
    ),
    "ablations": Expected(
        ("configuration.json", "ablations.png"),
        (
            Within("ablations.csv", "hits", 0.9, 1.0, (("variant", "defaults"),)),
            Within("ablations.csv", "confident_wrong", 0, 0, (("variant", "defaults"),)),
            Within("ablations.csv", "hits", 0.5, 0.85, (("variant", "no jump edges"),)),
        ),
    ),
    "cascade": Expected(
        ("configuration.json", "cascade.png"),
        (
            Within("cascade.csv", "top1", 0.8, 1.0),
            Within("cascade.csv", "top1_all", 0.8, 1.0),
            Within("cascade.csv", "lost", 0, 3),
        ),
    ),
    "defaults": Expected(
        ("configuration.json", "defaults.png"),
        (
            Within("defaults.csv", "top1_halved", 0.85, 1.0),
            Within("defaults.csv", "top1_doubled", 0.91, 1.0, (("setting", "(defaults)"),)),
            Within("defaults.csv", "effect", 0.03, 0.2, WINDOW),
        ),
    ),
    "robustness": Expected(
        ("configuration.json", "noise.png", "changes.png", "view.png", "resolution.png"),
        (
            Within("robustness.csv", "confident_wrong", 0.0, 0.0),
            Within("robustness.csv", "confident_right", 0.9, 1.0, (("value", "0.0"),)),
            Within("robustness.csv", "confident_right", 0.0, 0.3, (("value", "0.1"),)),
            Within("robustness.csv", "top1", 0.5, 0.85, (("value", "0.5"),)),
            Within("robustness.csv", "top1", 0.8, 1.0, (("job", "view"),)),
        ),
    ),
    "calibration": Expected(
        ("configuration.json", "calibration.png"),
        (Within("calibration.csv", "even_e_m", 0.06, 0.11),),
    ),
    "clutter": Expected(
        ("configuration.json", "clutter.png"),
        (
            Within("clutter.csv", "anchors", 9.0, 15.0),
            Within("clutter.csv", "repeatability", 0.3, 0.75),
            Within("clutter.csv", "repeatability", 0.6, 0.75, (("place", "lab 0"),)),
            Within("clutter.csv", "small_share", 0.03, 0.13),
        ),
    ),
    "occupancy_grid": Expected(
        ("configuration.json", "map.yaml", "map.pgm", "grid.png"),
        (
            Within("occupancy_grid.csv", "right", 0.9, 1.0),
            Within("occupancy_grid.csv", "confident_right", 0.8, 1.0),
            Within("occupancy_grid.csv", "confident_wrong", 0.0, 0.0),
            Within("occupancy_grid.csv", "median_m", 0.0, 0.06),
        ),
    ),
    "signature": Expected(
        ("configuration.json", "signature.png", "discriminant.npz"),
        (Within("signature.csv", "ratio", 3.0, 5.0, (("axis", "0"),)),),
    ),
    "pose_error": Expected(
        ("configuration.json", "pose_error.png"),
        (
            Within("pose_error.csv", "median_m", 0.0, 0.01, (("lab", "all"),)),
            Within("pose_error.csv", "median_deg", 0.0, 0.1, (("lab", "all"),)),
            Within("pose_error.csv", "inside_95", 0.9, 1.0, (("lab", "all"),)),
        ),
    ),
    "maps": Expected(
        ("configuration.json", "belgioioso.png"),
        (
            Within("maps.csv", "false_arcs", 0, 0),
            Within("maps.csv", "recognized", 0.9, 1.0),
            Within("maps.csv", "arc_m", 0.0, 0.05),
            Within("maps.csv", "arc_deg", 0.0, 0.6),
            Within("maps.csv", "half_false_arcs", 0, 0),
        ),
    ),
    "tracks": Expected(
        ("configuration.json", "tracks.png", "belgioioso.interleaved.csv"),
        (
            Within("tracks.csv", "right", 0.95, 1.0),
            Within("tracks.csv", "committed_right", 0.9, 1.0),
            Within("tracks.csv", "committed_wrong", 0.0, 0.02),
            Within("tracks.csv", "first_fix_m", 0.0, 2.0),
        ),
    ),
    "kidnappings": Expected(
        ("configuration.json", "kidnappings.png"),
        (
            Within("kidnappings.csv", "recovered_8_m", 1, 1, HYPOTHESES),
            Within("kidnappings.csv", "committed_right", 0.85, 1.0, HYPOTHESES),
            Within("kidnappings.csv", "committed_wrong", 0.0, 0.02, HYPOTHESES),
        ),
    ),
    "office": Expected(
        ("configuration.json", "office-0.png"),
        (
            Within("office.csv", "cycles", 1, 1),
            Within("office.csv", "false_arcs", 0, 0),
            Within("office.csv", "recognized", 0.95, 1.0),
            Within("office.csv", "arc_m", 0.0, 0.02),
            Within("office.csv", "rms_m", 0.0, 0.1),
        ),
    ),
    "volume": Expected(
        ("configuration.json", "volume.png", "claims.png", "hypotheses.csv"),
        (
            Within("volume.csv", "inside", 0.9, 1.0),
            Within("volume.csv", "confirmed_off_m", 0.0, 0.05),
            Within("volume.csv", "confirmed_radius_m", 0.4, 0.7),
            Within("volume.csv", "long_radius_m", 1.5, 4.0),
        ),
    ),
    "course": Expected(
        ("configuration.json", "course.png", "cycles.png"),
        (
            Within("course.csv", "strongest_is_right", 0.97, 1.0, IMAGES),
            Within("course.csv", "committed_wrong", 0.0, 0.01, IMAGES),
            Within("course.csv", "strongest_is_right", 0.0, 0.97, (("sources", "2000 particles"),)),
        ),
    ),
    "soak": Expected(
        ("configuration.json", "soak.png"),
        (
            Within("soak.csv", "sum_error", 0.0, 1e-9),
            Within("soak.csv", "right", 0.85, 1.0),
            Within("soak.csv", "wrong", 0.0, 0.1),
        ),
    ),
    "determinism": Expected(
        ("configuration.json",), (Within("determinism.csv", "differing", 0, 0),)
    ),
    "kills": Expected(
        ("configuration.json",),
        (
            Within("kills.csv", "kills", 2, 2),
            Within("kills.csv", "broken", 0, 0),
        ),
    ),
    "idc": Expected(
        ("configuration.json", "idc.png"),
        (
            Within("idc.csv", "median_m", 0.0, 0.06, (("split", "all"),)),
            Within("idc.csv", "median_deg", 0.0, 0.6, (("split", "all"),)),
            Within("idc.csv", "within", 0.9, 1.0, (("split", "all"),)),
        ),
    ),
    "scan_classifier": Expected(
        ("configuration.json", "scan_classifier.png"),
        (
            Within("scan_classifier.csv", "here", 0.7, 1.0, (("seed", "mean"),)),
            Within("scan_classifier.csv", "far", 0.0, 0.3, (("seed", "mean"),)),
        ),
    ),
    "image_classifier": Expected(
        ("configuration.json", "image_classifier.png", "images.png"),
        (
            Within("image_classifier.csv", "here", 0.8, 1.0, (("floor", "mean"),)),
            Within("image_classifier.csv", "far", 0.0, 0.2, (("floor", "mean"),)),
        ),
    ),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_quick_experiment_writes_all_and_its_figures_lie_where_they_should(name, tmp_path):
    if name not in CHOSEN and "all" not in CHOSEN:
        pytest.skip(f"takes a while: APRJAX_EXPERIMENTS={name} runs it")
    status = main([name, "--quick", "--out", str(tmp_path)])
    folder = tmp_path / name
    assert status == 0, (folder / "output.txt").read_text()
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert {*EXPECTED[name].files} <= {*manifest["experiments"][name]["files"]}
    for picture in folder.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")
    for figure in EXPECTED[name].figures:
        values = column(folder / figure.table, figure.column, dict(figure.where))
        assert values, f"{figure.table}: no row holds {figure.where}"
        assert all(figure.low <= value <= figure.high for value in values), (figure, values)


def test_something_is_expected_of_every_experiment():
    assert EXPECTED.keys() == EXPERIMENTS.keys()


def column(path, name, where):
    """The values of a column in the rows that hold what `where` says."""
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if where.items() <= row.items()]
    return [float(row[name]) for row in rows]
