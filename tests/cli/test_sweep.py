"""`aprjax sweep` and the sweeps behind it, on the small logs: one program serves all tests."""

import csv
import json
import threading

import jax
import numpy as np
import pytest

import aprjax
from aprjax import programs
from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.io.pieces import Pieces
from aprjax.matcher import MatchConfig
from aprjax.metrics import score_matches
from aprjax.sweeping import run as sweep_run
from aprjax.sweeping.axes import configured, product
from aprjax.sweeping.run import sweep, sweep_grid

# Configurations are grouped by their voting, so with this order the groups are interleaved.
SET = ("--set", "congruence.tolerance=0.04:0.08:2", "--set", "voting.length=0.06:0.12:2")
AXES = {"congruence.tolerance": [0.04, 0.08], "voting.length": [0.06, 0.12]}


@pytest.fixture(scope="module")
def entries(logs):
    return [list(aprjax.read_log(path)) for path in logs]


@pytest.fixture(scope="module")
def references(entries):
    return aprjax.ReferenceSet.build([entry.scan for entry in entries[0]])


@pytest.fixture(scope="module")
def scans(entries):
    return aprjax.Scan.stack([entry.scan for entry in entries[1]])


def sweeping(logs, out):
    return ("sweep", *logs, *SET, "--out", out)


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(logs, tmp_path_factory):
    """What the command wrote."""
    from aprjax.cli.main import main

    out = tmp_path_factory.mktemp("sweep")
    assert main([str(word) for word in sweeping(logs, out)]) == 0
    return out


def test_each_configuration_finds_what_a_run_of_its_own_finds(scans, references):
    axes = AXES | {"features.extraction.surface.window": [0.4, 0.5]}
    found = sweep_grid(scans, references, axes, MatchConfig(hypotheses=1))
    assert found.quality.shape == (8, 20, 1)
    columns = product(axes)
    seen = set()
    for k in range(8):
        *matched, window = (column[k] for column in columns.values())
        features = configured(FeatureConfig(), {"extraction.surface.window": window})
        config = configured(MatchConfig(), dict(zip(AXES, matched, strict=True)))
        own = aprjax.match_batch(
            scans, aprjax.ReferenceSet.build(references.scans, features), config
        )
        np.testing.assert_array_equal(found.reference[k, :, 0], own.reference[:, 0])
        np.testing.assert_array_equal(found.confident[k], own.confident)
        np.testing.assert_array_equal(found.status[k], own.status)
        np.testing.assert_allclose(found.quality[k, :, 0], own.quality[:, 0], atol=1e-5)
        np.testing.assert_allclose(found.T_ref_query[k, :, 0], own.T_ref_query[:, 0], atol=1e-5)
        seen.add(found.quality[k].tobytes())
    assert len(seen) == 8  # the values do reach the stages


def test_other_values_compile_nothing(scans, references, folder):
    def run(*lengths):
        axes = {"voting.length": lengths, "congruence.tolerance": [0.05, 0.1]}
        return sweep_grid(scans, references, axes, MatchConfig(hypotheses=1))

    run(0.1)
    compiled = sweep_run._sweep_program.compiled
    run(0.07, 0.08, 0.09)
    assert sweep_run._sweep_program.compiled == compiled > 0


def test_sweeps_are_forgotten_with_the_other_programs(scans, references, folder):
    sweep_grid(scans, references, {"confident": [0.1, 0.2]}, MatchConfig(hypotheses=1))
    compiled = sweep_run._sweep_program.compiled
    assert compiled > 0
    assert sweep_run._sweep_program in programs._programs
    sweep_run._sweep_program.forget()
    assert sweep_run._sweep_program.compiled == 0


def test_the_table_has_the_figures_of_the_answers(entries, references, scans, folder):
    poses = [np.array([entry.logged_pose for entry in log]) for log in entries]
    mapped = np.ones(20, bool)  # the logs' queries are taken near references
    for k, row in enumerate(rows_of(folder / "sweep.csv")):
        values = {name: column[k] for name, column in product(AXES).items()}
        assert {name: np.float32(row[name]) for name in AXES} == values
        own = aprjax.match_batch(scans, references, configured(MatchConfig(), values))
        scores = score_matches(own, references.ids, *poses, mapped)
        assert float(row["top1"]) == pytest.approx(scores.top1)
        assert float(row["hits"]) == pytest.approx(scores.hits)
        counts = [int(row[name]) for name in ("correct", "false", "none")]
        assert sum(counts) == int(row["queries"]) == int(row["mapped"]) == 20
        assert counts[0] + counts[1] == int(own.confident.sum())
        assert counts[1] == 0


def test_the_folder_holds_tables_pictures_and_what_was_run(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert {*manifest["files"], "manifest.json"} == {path.name for path in folder.iterdir()}
    assert manifest["configurations"] == len(rows_of(folder / "sweep.csv")) == 4
    assert manifest["axes"]["voting.length"] == pytest.approx([0.06, 0.12])
    assert from_dict(MatchConfig, manifest["match"]).hypotheses == 1
    assert manifest["features"] == to_dict(FeatureConfig())
    for name in ("sweep.png", "curves.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert {row["configuration"] for row in rows_of(folder / "curves.csv")} == set("0123")
    assert all(float(row["seconds"]) > 0 for row in rows_of(folder / "times.csv"))


class KilledError(Exception):
    pass


def test_an_interrupted_sweep_goes_on_where_it_was_with_the_same_tables(
    logs, folder, tmp_path, command, monkeypatch
):
    stored, real, lock = [], Pieces.store, threading.Lock()

    def store(self, name, columns):
        with lock:
            if stored:
                raise KilledError
            real(self, name, columns)
            stored.append(name)

    monkeypatch.setattr(Pieces, "store", store)
    with pytest.raises(KilledError):
        command(*sweeping(logs, tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["pieces"]

    computed, program = [], sweep_run._sweep_program
    monkeypatch.setattr(Pieces, "store", real)
    monkeypatch.setattr(
        sweep_run, "_sweep_program", lambda *a, **k: computed.append(1) or program(*a, **k)
    )
    status, out, err = command(*sweeping(logs, tmp_path))
    assert (status, out) == (0, "")
    assert err.startswith("4 configurations, 20 queries, 8 references: best hits ")
    # Two lengths that vote, for 8 queries at a time: one of six pieces was kept.
    assert len(computed) == 5
    for name in ("sweep.csv", "curves.csv", "manifest.json"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()
    assert not (tmp_path / "pieces").exists()


def test_pieces_of_other_values_are_not_mixed_in(logs, folder, tmp_path, command):
    Pieces(tmp_path / "pieces", "another run").store("0000-00000000-000000", {"a": np.zeros(1)})
    assert command(*sweeping(logs, tmp_path))[0] == 0
    assert (tmp_path / "sweep.csv").read_bytes() == (folder / "sweep.csv").read_bytes()


def test_which_queries_count_can_be_told(logs, folder, tmp_path, command):
    mask = tmp_path / "mapped.txt"
    mask.write_text("0\n" * 5 + "1\n" * 15)
    assert command(*sweeping(logs, tmp_path / "out"), "--mapped", mask)[0] == 0
    assert {row["mapped"] for row in rows_of(tmp_path / "out" / "sweep.csv")} == {"15"}
    mask.write_text("1\n" * 19)
    status, _, err = command(*sweeping(logs, tmp_path / "out"), "--mapped", mask)
    assert (status, err) == (1, f"aprjax: {mask}: does not hold 20 of 0 and 1\n")


@pytest.mark.parametrize(
    "axis",
    [
        "congruence.tolerance",
        "congruence.tolerance=",
        "congruence.tolerance=1:2",
        "congruence.tolerance=1:2:0",
        "congruence.tolerance=1:2:2.5",
        "congruence.tolerance=1:nan:3",
        "congruence.tolerance=1:1:2",
        "congruence.tolerance=1:2:1",
        "congruence.tolerance=0:1:10001",
        "congruence.tolerance=1e39:1e300:2",
        "congruence.tolerence=1:2:2",
        "top_k=1:5:5",
        "=1:2:2",
        "confident=0:2:3",
        "features.extraction.surface.window=-1:1:3",
    ],
)
def test_bad_axes_are_bad_usage(logs, tmp_path, command, axis):
    status, out, err = command("sweep", *logs, "--out", tmp_path / "out", "--set", axis)
    assert not (tmp_path / "out").exists()
    assert (status, out) == (2, "")
    assert "error: argument --set: " in err
    assert axis.split("=")[0] in err.splitlines()[-1]


def test_an_axis_twice_and_too_many_configurations_are_bad_usage(logs, tmp_path, command):
    axis = "congruence.tolerance=0:1:200"
    for other in (axis, "congruence.relative=0:1:200"):
        words = ("sweep", *logs, "--out", tmp_path, "--set", axis, "--set", other)
        status, _, err = command(*words)
        assert status == 2
        assert err.splitlines()[-1].startswith("aprjax sweep: error: argument --set: ")


def test_references_without_poses_cannot_score(logs, references, tmp_path, command):
    saved = tmp_path / "references.npz"
    aprjax.save_references(references, saved)
    status, _, err = command("sweep", saved, logs[1], *SET, "--out", tmp_path / "out")
    assert status == 1
    assert err == f"aprjax: {saved}: states no poses of its scans, which score the answers\n"


def test_thresholds_of_different_lengths_are_refused(scans, references):
    unlike = configured(MatchConfig(), {"confident": [0.1, 0.2], "min_quality": [0.0, 0.1, 0.2]})
    for configs in (unlike, MatchConfig()):
        with pytest.raises(ValueError, match=r"^configs: "):
            sweep(scans, references, configs)


def test_leaves_of_the_result_lie_on_the_host(scans, references):
    configs = configured(MatchConfig(hypotheses=1), {"congruence.tolerance": [0.05, 0.08]})
    found = sweep(scans, references, configs)
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(found))


def test_where_a_process_allows_64_bits_a_sweep_finds_the_same(
    logs, folder, tmp_path, command, wide
):
    wide()
    assert command(*sweeping(logs, tmp_path))[0] == 0
    for name in ("sweep.csv", "curves.csv", "sweep.png", "curves.png"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.usefixtures("folder", "full_disk")
def test_a_full_disk_is_one_line_and_leaves_no_half_file(logs, tmp_path, command):
    status, _, err = command(*sweeping(logs, tmp_path))
    assert status == 1
    assert err.startswith(f"aprjax: {tmp_path / 'pieces'}")
    assert err.endswith(": File too large\n")
    assert err.count("\n") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_with_pyarrow_the_same_table_is_written_as_parquet(logs, folder, tmp_path, command):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert command(*sweeping(logs, tmp_path))[0] == 0
    columns = parquet.read_table(tmp_path / "sweep.parquet").to_pylist()
    rows = rows_of(folder / "sweep.csv")
    assert [{name: str(value) for name, value in row.items()} for row in columns] == rows
    assert "sweep.parquet" in json.loads((tmp_path / "manifest.json").read_text())["files"]
