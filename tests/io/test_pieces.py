import numpy as np
import pytest

from aprjax.io.pieces import Pieces, fingerprint

COLUMNS = {"reference": np.arange(6).reshape(3, 2), "status": np.array(["ok", "ambiguous", "ok"])}


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "run.pieces"


def test_a_piece_comes_back_as_it_was_stored(folder):
    Pieces(folder, "a").store("0-3", COLUMNS)
    found = Pieces(folder, "a").load("0-3")
    assert found is not None
    assert found.keys() == COLUMNS.keys()
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(found[name], values, strict=True)


def test_pieces_of_another_run_are_not_used(folder):
    Pieces(folder, "a").store("0-3", COLUMNS)
    assert Pieces(folder, "b").load("0-3") is None


def test_a_piece_that_is_missing_or_damaged_is_none(folder):
    pieces = Pieces(folder, "a")
    assert pieces.load("0-3") is None
    pieces.store("0-3", COLUMNS)
    path = folder / "0-3.npz"
    path.write_bytes(path.read_bytes()[:-40])
    assert pieces.load("0-3") is None


def test_nothing_is_left_of_pieces_that_are_discarded(folder):
    pieces = Pieces(folder, "a")
    pieces.store("0-3", COLUMNS)
    pieces.discard()
    assert not folder.exists()


def test_what_is_no_piece_stays_when_pieces_are_discarded(folder):
    pieces = Pieces(folder, "a")
    pieces.store("0-3", COLUMNS)
    Pieces(folder, "b").store("3-6", COLUMNS)  # of a run before
    (folder / ".0123456789abcdef.tmp").write_bytes(b"half a piece")
    (folder / "notes.txt").write_text("mine")
    np.savez(folder / "mine.npz", format=np.array("something else"))
    (folder / "more").mkdir()
    pieces.discard()
    assert {path.name for path in folder.iterdir()} == {"notes.txt", "mine.npz", "more"}


@pytest.mark.parametrize(
    "other",
    [
        (np.arange(4), np.float32(0.5)),
        (np.arange(4)[::-1], np.float32(0.25)),
        (np.arange(4, dtype=np.int32), np.float32(0.25)),
        (np.arange(4).reshape(2, 2), np.float32(0.25)),
        ([np.arange(4)], np.float32(0.25)),
        (np.arange(4), None),
    ],
    ids=["value", "order", "type", "shape", "structure", "absent"],
)
def test_whatever_differs_changes_the_fingerprint(other):
    one = fingerprint(np.arange(4), np.float32(0.25))
    assert one == fingerprint(np.arange(4), np.float32(0.25))
    assert one != fingerprint(*other)
