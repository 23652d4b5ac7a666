"""Files that claim more than they hold, or more than memory does."""

import io
import json
import struct
import tracemalloc
import zipfile

import jax
import numpy as np
import pytest

from aprjax.configuration import to_dict
from aprjax.features import FeatureConfig, describe
from aprjax.io.archive import MOST_BEAMS, MOST_REFERENCES, read_features
from aprjax.io.reference_file import FORMAT, ReferenceFileError, load_references
from aprjax.scan import Scan
from aprjax.world.store import MapFileError, load_map, looks_like_map

LITTLE = 8 << 20  # bytes of memory that a refusal may take


def contents(count=3, beams=2, **features):
    """The arrays of a reference file of scans of two beams."""
    ones = np.ones(count, np.float32)
    config = to_dict(FeatureConfig())
    for name, values in features.items():
        config[name] |= values
    return {
        "format": np.array(FORMAT),
        "version": np.int64(2),
        "ids": np.arange(count, dtype=np.int32),
        "next_id": np.int64(count),
        "T_world_ref": np.zeros((count, 3)),
        "ranges": np.ones((count, beams), np.float32),
        "features": np.array(json.dumps(config)),
        "angle_min": ones,
        "angle_increment": 0.01 * ones,
        "range_min": 0 * ones,
        "range_max": 10 * ones,
        "beams": np.full(count, 2, np.int32),
    }


def packed(path, arrays, method=zipfile.ZIP_DEFLATED, **raw):
    """An archive of arrays, and of members that are bytes already."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.save(buffer, array)
            archive.writestr(f"{name}.npy", buffer.getvalue())
        for name, data in raw.items():
            archive.writestr(f"{name}.npy", data)
    return path


def refused(path, at_most=LITTLE) -> str:
    """The line with which a file is refused, and that little memory was taken for it."""
    tracemalloc.start()
    try:
        with pytest.raises(ReferenceFileError) as caught:
            load_references(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < at_most
    message = str(caught.value)
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def header(shape, dtype="<f4") -> bytes:
    """The header of an array, with nothing behind it."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return buffer.getvalue()


def test_a_decompression_bomb_is_refused_before_it_is_unpacked(tmp_path):
    zeros = bytes(100 << 20)
    path = packed(tmp_path / "bomb", contents(), ranges2=zeros)
    del zeros
    assert path.stat().st_size < 1 << 20
    assert refused(path).startswith("claims to hold 10")
    with pytest.raises(MapFileError, match="claims to hold"):
        load_map(path)
    assert not looks_like_map(path)


def test_a_format_that_is_a_bomb_is_none(tmp_path):
    path = packed(tmp_path / "bomb", {}, format=header((1 << 24,), "<U1") + bytes(4 << 24))
    tracemalloc.start()
    assert not looks_like_map(path)
    assert tracemalloc.get_traced_memory()[1] < LITTLE
    tracemalloc.stop()


@pytest.mark.parametrize("shape", [(10**12,), (2**40, 2**40), (-1,), (-4, -4), (3, 7)])
def test_a_header_that_does_not_fit_its_contents_takes_no_memory(tmp_path, shape):
    arrays = contents()
    del arrays["ranges"]
    path = packed(tmp_path / "lie", arrays, ranges=header(shape) + bytes(64))
    assert refused(path) == "cut off or damaged: not a readable archive"


@pytest.mark.parametrize("claimed", [1, 0xFFFFFFF0])
def test_a_directory_that_lies_about_a_size_is_refused(tmp_path, claimed):
    path = packed(tmp_path / "lie", contents())
    data = bytearray(path.read_bytes())
    entry = data.index(b"PK\x01\x02")  # the first member's line of the central directory
    data[entry + 24 : entry + 28] = struct.pack("<I", claimed)
    path.write_bytes(data)
    assert refused(path).startswith(("cut off or damaged", "claims to hold"))


def test_objects_and_unusual_packing_are_refused(tmp_path):
    arrays = contents()
    path = packed(tmp_path / "object", arrays, more=header((1,), "|O") + b"cos\nsystem\n")
    assert refused(path) == "cut off or damaged: not a readable archive"
    path = packed(tmp_path / "lzma", arrays, zipfile.ZIP_LZMA)
    assert refused(path) == "cut off or damaged: not a readable archive"


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (contents(MOST_REFERENCES + 1), f"{MOST_REFERENCES + 1} references are more than"),
        (contents(3, MOST_BEAMS + 1), f"{MOST_BEAMS + 1} beams are more than {MOST_BEAMS}"),
        (contents(raster={"size": 385}), "features.raster.size is over 384"),
        (contents(extraction={"anchors": 1}), "features: anchors: 1 is not from 2 to 128"),
        (contents(raster={"points": 127}), "features: points: 127 is not between 1 and 126"),
        (contents(60_000, raster={"size": 384}), "its 60000 references would take "),
    ],
)
def test_what_would_take_too_much_memory_when_described_is_refused(tmp_path, arrays, message):
    path = packed(tmp_path / "large", arrays, zipfile.ZIP_STORED)
    assert refused(path, at_most=64 << 20).startswith(message)


def least(values: dict) -> dict:
    """The description of which every capacity is the least that a file may state."""
    smallest = {"anchors": 2, "length_tolerance": 0, "part_tolerance": 0}
    return {
        name: least(value)
        if isinstance(value, dict)
        else smallest.get(name, 1)
        if isinstance(value, int)
        else value
        for name, value in values.items()
    }


def test_scans_can_be_described_with_the_least_capacities_and_of_one_beam():
    config = read_features(json.dumps(least(to_dict(FeatureConfig()))))
    scan = Scan.make([1.0], angle_min=0.0, angle_increment=0.1, range_max=9.0)
    described = jax.eval_shape(describe, scan, config)
    assert described.anchors.valid.shape == (2,)
