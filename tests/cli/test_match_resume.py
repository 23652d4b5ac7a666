"""`aprjax match` interrupted and started again, and a log matched with itself."""

import csv
import gzip
import io

import numpy as np
import pytest

import aprjax
import aprjax.cli.match as cli_match
from aprjax.cli.main import main


class InterruptedRunError(Exception):
    pass


@pytest.fixture(scope="module")
def long(logs, tmp_path_factory):
    """The log of references, and one of 50 queries."""
    lines = gzip.decompress(logs[1].read_bytes()).splitlines(keepends=True)
    path = tmp_path_factory.mktemp("long") / "long.log"
    path.write_bytes(b"".join([*lines, *lines, *lines[:10]]))
    return logs[0], path


@pytest.fixture
def calls(monkeypatch):
    """Pieces of 20 queries, whose compilation other tests share.

    The number of calls so far, and after how many to stop for good.
    """
    counted = {"done": 0, "stop": None}
    matched = cli_match.match_batch

    def counting(*arguments, **options):
        if counted["done"] == counted["stop"]:
            raise InterruptedRunError
        counted["done"] += 1
        return matched(*arguments, **options)

    monkeypatch.setattr(cli_match, "_PIECES", (20,))
    monkeypatch.setattr(cli_match, "match_batch", counting)
    return counted


def run(logs, out, *options):
    assert main(["match", *map(str, logs), "--out", str(out), *options]) == 0
    return out.read_bytes()


def interrupt(logs, out, calls, *options):
    """A run that stops before its third and last piece."""
    calls["stop"] = calls["done"] + 2
    with pytest.raises(InterruptedRunError):
        main(["match", *map(str, logs), "--out", str(out), *options])
    calls.update(done=0, stop=None)


def test_an_interrupted_run_goes_on_where_it_was_with_the_same_table(long, tmp_path, calls):
    whole = run(long, tmp_path / "whole.csv")
    out = tmp_path / "m.csv"
    interrupt(long, out, calls)
    assert not out.exists()
    assert run(long, out) == whole
    assert calls["done"] == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.csv", "whole.csv"]


def test_what_another_run_left_is_not_mixed_in(long, tmp_path, calls):
    out = tmp_path / "m.csv"
    interrupt(long, out, calls, "--min-quality", "0.1")
    first = run(long, out)
    assert calls["done"] == 3
    assert run(long, tmp_path / "whole.csv") == first


def test_pieces_for_other_poses_of_the_references_are_not_mixed_in(long, tmp_path, calls):
    references, queries = long
    known = aprjax.ReferenceSet.build([entry.scan for entry in aprjax.read_log(references)])
    stored, out = tmp_path / "known.npz", tmp_path / "m.csv"
    aprjax.save_references(known, stored)
    interrupt((stored, queries), out, calls)
    poses = np.zeros((len(known), 3))
    placed = aprjax.ReferenceSet.build(known.scans, T_world_ref=poses)
    aprjax.save_references(placed, stored)
    run((stored, queries), out)
    assert calls["done"] == 3


def test_no_scan_answers_itself_where_that_is_asked_for(logs, tmp_path, calls):
    own = tmp_path / "own.log"  # its first scans are those of the references
    own.write_bytes(b"".join(gzip.decompress(path.read_bytes()) for path in logs))
    tables = {}
    for name, options in (("with", ()), ("without", ("--exclude-self",))):
        text = run((logs[0], own), tmp_path / f"{name}.csv", *options).decode()
        tables[name] = list(csv.DictReader(io.StringIO(text)))
    found = [row["reference"] == row["query"] for row in tables["with"] if row["rank"] == "0"]
    assert sum(found) >= 6
    assert not any(row["reference"] == row["query"] for row in tables["without"])
    assert calls["done"] == 4
