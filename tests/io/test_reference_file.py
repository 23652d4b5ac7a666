import io
import json
import zipfile
from typing import Any

import jax
import numpy as np
import pytest

from aprjax.batch import match_batch
from aprjax.configuration import to_dict
from aprjax.features import FeatureConfig
from aprjax.io.reference_file import (
    ReferenceFileError,
    load_references,
    looks_like_references,
    save_references,
)
from aprjax.references import ReferenceSet
from aprjax.relations.histograms import RelationConfig
from tests.worlds import free_pose, office, scan_at

# As many as the logs of the command line's tests have, so that both share their compilations.
REFERENCES, QUERIES = 8, 20


@pytest.fixture(scope="module")
def scans():
    rng = np.random.default_rng(1)
    world = office(seed=5)
    count = REFERENCES + 1 + QUERIES
    return [scan_at(world, free_pose(world, rng), noise=0.01, rng=rng) for _ in range(count)]


@pytest.fixture(scope="module")
def references(scans):
    """A set with a gap in its ids, whose last reference is gone too."""
    poses = np.arange(3.0 * (REFERENCES + 1)).reshape(-1, 3)
    poses[5] = np.nan
    return ReferenceSet.build(scans[: REFERENCES + 1], T_world_ref=poses).remove([3])


@pytest.fixture(scope="module")
def saved(references, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "references"
    save_references(references, path)
    return path


def arrays_of(path) -> dict[str, Any]:
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files}


def refused(path) -> str:
    """The one line with which a file is refused, without its path."""
    with pytest.raises(ReferenceFileError) as caught:
        load_references(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def test_round_trip_keeps_every_bit(scans, references, saved):
    loaded = load_references(saved)
    assert loaded.next_id == references.next_id == REFERENCES + 1
    np.testing.assert_array_equal(loaded.ids, references.ids)
    assert 3 not in loaded.ids
    np.testing.assert_array_equal(loaded.T_world_ref, references.T_world_ref)
    assert np.isnan(loaded.T_world_ref).all(axis=1).sum() == 1
    queries = scans[-QUERIES:]
    first = match_batch(queries, references)
    second = match_batch(queries, loaded)
    assert np.asarray(first.valid).any()
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def test_the_file_has_exactly_the_name_given_and_the_same_bytes_each_time(
    references, saved, tmp_path
):
    save_references(references, tmp_path / "again")
    assert [path.name for path in tmp_path.iterdir()] == ["again"]
    assert (tmp_path / "again").read_bytes() == saved.read_bytes()
    assert looks_like_references(saved)


def test_a_file_of_version_1_has_no_poses(references, saved, tmp_path):
    arrays = arrays_of(saved) | {"version": np.int64(1)}
    del arrays["T_world_ref"]
    np.savez(tmp_path / "old.npz", **arrays)
    loaded = load_references(tmp_path / "old.npz")
    np.testing.assert_array_equal(loaded.ids, references.ids)
    assert np.isnan(loaded.T_world_ref).all()


def test_the_description_is_kept(references, saved):
    stored = json.loads(str(arrays_of(saved)["features"]))
    assert stored == to_dict(references.config) == to_dict(FeatureConfig())


def test_an_empty_set_is_not_saved(references, tmp_path):
    with pytest.raises(ValueError, match="empty"):
        save_references(references.remove(references.ids.tolist()), tmp_path / "none")
    assert not list(tmp_path.iterdir())


def test_missing_directory_empty_and_foreign_files(saved, tmp_path):
    assert refused(tmp_path / "absent") == "No such file or directory"
    assert refused(tmp_path) == "Is a directory"
    other = tmp_path / "other"
    other.write_bytes(b"")
    assert refused(other) == "the file is empty"
    other.write_bytes(b"ODOM 0 0 0 0 0 0 0 host 0\n")
    assert refused(other) == "not a reference file"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("notes.txt", "hello")
    assert refused(other) == "an archive, but not a reference file"
    np.savez(other.with_suffix(".npz"), ranges=np.zeros((2, 3)))
    assert refused(other.with_suffix(".npz")) == "an archive, but not a reference file"


def test_cut_off_anywhere(saved, tmp_path):
    data = saved.read_bytes()
    short = tmp_path / "short"
    lengths = {
        *range(1, 60),
        *range(60, len(data), len(data) // 150),
        *range(len(data) - 30, len(data)),
    }
    for length in sorted(lengths):
        short.write_bytes(data[:length])
        assert refused(short) in {
            "cut off or damaged: not a readable archive",
            "not a reference file",  # of one byte
        }


def test_flipped_bits_are_found_or_harmless(references, saved, tmp_path):
    data = saved.read_bytes()
    damaged, found = tmp_path / "damaged", 0
    rng = np.random.default_rng(0)
    places = rng.choice(len(data), 150, replace=False)
    for place in places:
        byte = data[place] ^ (1 << rng.integers(8))
        damaged.write_bytes(data[:place] + bytes([byte]) + data[place + 1 :])
        try:
            loaded = load_references(damaged)
        except ReferenceFileError as error:
            found += 1
            assert "\n" not in str(error)
        else:
            # Only what says nothing of the contents, such as a date.
            np.testing.assert_array_equal(loaded.scans.ranges, references.scans.ranges)
    assert found > 0.8 * len(places)


def _feature(**changes: Any) -> np.ndarray:
    return np.array(json.dumps(to_dict(FeatureConfig()) | changes))


def _edge(**changes: int) -> dict[str, Any]:
    return {"virtual_edge": changes}


IDS = np.arange(REFERENCES, dtype=np.int32)
ONES = np.ones(REFERENCES, np.float32)

DEFECTS: list[tuple[dict[str, Any], str]] = [
    ({"format": np.array("other")}, "an archive, but not a reference file"),
    ({"version": np.int64(3)}, "version 3 is newer than 2, the latest known"),
    ({"version": np.int64(0)}, "version 0 does not exist"),
    ({"version": np.array("1")}, "version is <U1, not int64"),
    ({"ids": None}, "ids is missing"),
    ({"ranges": None}, "ranges is missing"),
    ({"beams": None}, "beams is missing"),
    ({"features": None}, "features is missing"),
    ({"ids": IDS.astype(float)}, "ids is float64, not int32"),
    ({"ids": IDS[:, None]}, r"ids has shape \(8, 1\), not \(any\)"),
    ({"ids": IDS[:-1]}, r"ranges has shape \(8, 192\), not \(7, any\)"),
    ({"ids": IDS[:0]}, "there are no references"),
    ({"ids": IDS[::-1].copy()}, r"ids\[1\]: 6 does not follow 7"),
    ({"ids": IDS // 2}, r"ids\[1\]: 0 does not follow 0"),
    ({"ids": IDS - 1}, r"ids\[0\]: -1 is negative"),
    ({"next_id": np.int64(7)}, "next_id: 7 does not follow [78]"),
    ({"next_id": np.int64(2**40)}, "next_id: 1099511627776 does not follow 8"),
    ({"T_world_ref": None}, "T_world_ref is missing"),
    ({"T_world_ref": np.zeros((8, 2))}, r"T_world_ref has shape \(8, 2\)"),
    ({"T_world_ref": np.full((8, 3), np.inf)}, r"T_world_ref\[0\]: .* is not finite"),
    ({"T_world_ref": np.full((8, 3), 1e300)}, r"T_world_ref\[0\]: .* is not within"),
    ({"ranges": np.zeros((8, 192))}, "ranges is float64, not float32"),
    ({"ranges": np.zeros(8, np.float32)}, r"ranges has shape \(8,\), not \(8, any\)"),
    ({"angle_min": ONES[:-2]}, r"angle_min has shape \(6,\), not \(8\)"),
    ({"angle_min": ONES * np.nan}, r"angle_min\[0\]: nan is not finite"),
    ({"range_max": ONES * np.inf}, r"range_max\[0\]: inf is not finite"),
    ({"range_max": ONES * 0}, r"range_min\[0\]: .* is negative or not below range_max"),
    ({"range_min": -ONES}, r"range_min\[0\]: .* is negative or not below range_max"),
    ({"angle_increment": ONES * 0}, r"angle_increment\[0\]: .* is zero, or"),
    ({"angle_increment": ONES}, r"angle_increment\[0\]: .* is zero, or"),
    ({"beams": (IDS * 0 + 999)}, r"beams\[0\]: 999 is not from 0 to"),
    ({"features": np.zeros(3)}, "features is float64, not text"),
    ({"features": np.array("{")}, "features is not JSON"),
    ({"features": np.array("[" * 100_000)}, "features is not JSON"),
    ({"features": np.array("[]")}, "features is not a group of fields"),
    ({"features": _feature(sonar={})}, "features has an unknown field 'sonar'"),
    ({"features": _feature(extraction={"legs": 4})}, "features.extraction has an unknown field"),
    ({"features": _feature(extraction=5)}, "features.extraction is not a group of fields"),
    ({"features": _feature(extraction={"anchors": 1.5})}, "anchors is not a whole number from 1"),
    ({"features": _feature(extraction={"anchors": -1})}, "anchors is not a whole number from 1"),
    ({"features": _feature(extraction=_edge(direction_bins=0))}, "bins is not a whole number from"),
    ({"features": _feature(extraction=_edge(offset_bins=0))}, "offset_bins is not a whole number"),
    ({"features": _feature(relation={"length_tolerance": -1})}, "is not a whole number from 0"),
    ({"features": _feature(extraction={"apart": 10**400})}, "apart is not a finite number"),
    ({"features": _feature(extraction={"apart": -1e39})}, "apart is not a finite number"),
    ({"ranges": np.zeros((8, 0), np.float32), "beams": 0 * IDS}, "ranges has no beams"),
    ({"features": _feature(extraction={"apart": "x"})}, "apart is not a finite number"),
    ({"features": _feature(extraction={"apart": float("nan")})}, "apart is not a finite number"),
]


@pytest.mark.parametrize(("changes", "message"), DEFECTS)
def test_contents_that_no_set_has(saved, tmp_path, changes, message):
    arrays = arrays_of(saved) | changes
    path = tmp_path / "wrong.npz"
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(ReferenceFileError, match=message):
        load_references(path)
    refused(path)


def test_pickled_objects_are_never_loaded(saved, tmp_path):
    arrays = arrays_of(saved) | {"features": np.array({"a": print}, object)}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    path = tmp_path / "pickled"
    path.write_bytes(buffer.getvalue())
    refused(path)


def test_fields_that_an_older_file_lacks_have_their_defaults(saved, tmp_path):
    arrays = arrays_of(saved) | {"features": np.array('{"extraction": {"apart": 0.5}}')}
    path = tmp_path / "older.npz"
    np.savez(path, **arrays)
    config = load_references(path).config
    assert float(config.extraction.apart) == 0.5
    assert config.extraction.anchors == FeatureConfig().extraction.anchors


def test_what_a_file_may_not_ask_for_is_not_written(scans, tmp_path):
    config = FeatureConfig(relation=RelationConfig(part_tolerance=5))
    with pytest.raises(ValueError, match=r"^features\.relation\.part_tolerance is over 4$"):
        save_references(ReferenceSet.build(scans[:2], config), tmp_path / "large")
    assert not list(tmp_path.iterdir())
