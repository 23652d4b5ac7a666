import tracemalloc

import numpy as np
import pytest

import aprjax
from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.io.occupancy_grid import OccupancyGridError, read_occupancy_grid, write_occupancy_grid

YAML = """image: map.pgm
resolution: 0.05
origin: [-1.5, 2.0, 0.3]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# Three columns, two rows; the first is the upper one.
IMAGE = b"P2\n3 2\n255\n0 205 254\n254 254 0\n"
CELLS = [[0, 0, 100], [100, -1, 0]]


def write(folder, yaml=YAML, image=IMAGE):
    (folder / "map.yaml").write_text(yaml)
    (folder / "map.pgm").write_bytes(image)
    return folder / "map.yaml"


def pixels(*levels: int, maximum: int = 255, kind: bytes = b"P2") -> bytes:
    """An image of one row."""
    head = kind + b"\n%d 1\n%d\n" % (len(levels), maximum)
    if kind == b"P2":
        return head + b" ".join(b"%d" % level for level in levels) + b"\n"
    return head + np.array(levels, "u1" if maximum < 256 else ">u2").tobytes()


def random_grid(values, seed=0) -> OccupancyGrid:
    cells = np.random.default_rng(seed).choice(values, (7, 20))
    return OccupancyGrid.make(cells, 0.1, [1 / 3, -7e5, -2.5])


def test_the_first_row_of_the_image_is_the_highest_y(tmp_path):
    grid = aprjax.read_occupancy_grid(write(tmp_path))
    np.testing.assert_array_equal(grid.cells, CELLS)
    assert grid.resolution == 0.05
    np.testing.assert_array_equal(grid.T_world_grid, [-1.5, 2.0, 0.3])


def test_binary_and_plain_and_deep_images_say_the_same(tmp_path):
    deep = [0, 205 * 257, 254 * 257]
    for levels, maximum in (([0, 205, 254], 255), (deep, 65535)):
        for kind in (b"P2", b"P5"):
            path = write(tmp_path, image=pixels(*levels, maximum=maximum, kind=kind))
            np.testing.assert_array_equal(read_occupancy_grid(path).cells, [[100, -1, 0]])


@pytest.mark.parametrize("free_thresh", [0.1, 0.196, 0.25])
def test_what_map_saver_painted_unknown_is_unknown_whatever_free_thresh_it_wrote(
    tmp_path, free_thresh
):
    path = write(tmp_path, YAML.replace("0.196", str(free_thresh)))
    np.testing.assert_array_equal(read_occupancy_grid(path).cells, CELLS)


def test_in_any_other_image_free_thresh_says_what_is_free(tmp_path):
    yaml = YAML.replace("0.196", "0.25")
    path = write(tmp_path, yaml, pixels(0, 205, 220, 254))
    np.testing.assert_array_equal(read_occupancy_grid(path).cells, [[100, 0, 0, 0]])
    path = write(tmp_path, yaml.replace("negate: 0", "negate: 1"), pixels(0, 205, 254))
    np.testing.assert_array_equal(read_occupancy_grid(path).cells, [[0, 100, 100]])


@pytest.mark.parametrize(
    "yaml",
    [
        "\ufeff" + YAML,
        YAML + "...\n",
        "".join(f"  {line}\n" for line in YAML.splitlines()),
        *(YAML.replace("negate: 0", f"negate: {word}") for word in ("no", "off", "False")),
    ],
)
def test_what_every_reader_of_yaml_takes_is_taken(tmp_path, yaml):
    np.testing.assert_array_equal(read_occupancy_grid(write(tmp_path, yaml)).cells, CELLS)


def test_comments_in_the_header_and_a_small_maximum(tmp_path):
    image = b"P5 # CREATOR: map_saver 0.05 m/pix\n# another\n2 1\n#\n1\n\x00\x01"
    assert read_occupancy_grid(write(tmp_path, image=image)).cells.tolist() == [[100, 0]]


@pytest.mark.parametrize(
    ("mode", "negate", "expected"),
    [
        ("trinary", 0, [100, 100, -1, -1, 0, 0]),
        ("trinary", 1, [0, -1, -1, 100, 100, 100]),
        ("scale", 0, [100, 100, 67, 1, 0, 0]),
        ("scale", 1, [0, 33, 67, 100, 100, 100]),
        ("raw", 0, [0, 88, -1, -1, -1, -1]),
        # As nav2 has it; ROS 1's map_server negates raw too.
        ("raw", 1, [0, 88, -1, -1, -1, -1]),
    ],
)
def test_every_mode_means_what_map_server_makes_of_it(tmp_path, mode, negate, expected):
    yaml = YAML.replace("negate: 0", f"negate: {negate}\nmode: {mode}")
    image = pixels(0, 88, 127, 204, 254, 255)
    # (1 - 127/255 - 0.196) / 0.454 = 0.674; (1 - 204/255 - 0.196) / 0.454 = 0.009
    assert read_occupancy_grid(write(tmp_path, yaml, image)).cells.tolist() == [expected]


@pytest.mark.parametrize(
    "yaml",
    [
        YAML.replace("[-1.5, 2.0, 0.3]", "\n- -1.5\n- 2.0\n- 3.0e-1"),
        YAML.replace("[-1.5, 2.0, 0.3]", "[-1.5,\n  2.0, 0.3]"),
        "---\n" + YAML.replace("map.pgm", '"map.pgm"  # the image'),
        YAML.replace("map.pgm", "'map.pgm'").replace("negate: 0", "negate: false\nother: {a: 1}"),
        YAML.replace("\n", "\r\n"),
    ],
)
def test_yaml_as_different_tools_write_it(tmp_path, yaml):
    grid = read_occupancy_grid(write(tmp_path, yaml))
    np.testing.assert_array_equal(grid.cells, CELLS)
    np.testing.assert_array_equal(grid.T_world_grid, [-1.5, 2.0, 0.3])


@pytest.mark.parametrize("plain", [False, True], ids=["P5", "P2"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize(
    ("mode", "values"),
    [("trinary", [-1, 0, 100]), ("scale", range(101)), ("raw", range(-1, 101))],
)
def test_what_was_written_is_read_back(tmp_path, mode, values, negate, plain):
    grid = random_grid(list(values))
    path = tmp_path / "a map, of: '1'.yaml"
    write_occupancy_grid(grid, path, mode=mode, negate=negate, plain=plain)
    again = read_occupancy_grid(path)
    np.testing.assert_array_equal(again.cells, grid.cells)
    assert again.resolution == grid.resolution
    np.testing.assert_array_equal(again.T_world_grid, grid.T_world_grid)
    assert len(list(tmp_path.iterdir())) == 2


def test_greys_are_those_of_map_saver(tmp_path):
    write_occupancy_grid(OccupancyGrid.make(np.array([[-1, 0, 100]]), 0.05), tmp_path / "m.yaml")
    assert (tmp_path / "m.pgm").read_bytes() == b"P5\n3 1\n255\n\xcd\xfe\x00"


def test_trinary_sorts_by_the_grids_own_masks(tmp_path):
    grid = random_grid(list(range(-1, 101)))
    write_occupancy_grid(grid, tmp_path / "m.yaml", free_thresh=0.4, occupied_thresh=0.5)
    again = read_occupancy_grid(tmp_path / "m.yaml")
    np.testing.assert_array_equal(again.occupied, grid.occupied)
    np.testing.assert_array_equal(again.free, grid.free)


def test_unknown_cells_cannot_be_written_in_scale(tmp_path):
    with pytest.raises(ValueError, match=r"cells\[1, 0\]: no grey means -1 in mode scale"):
        write_occupancy_grid(
            OccupancyGrid.make(np.array([[0], [-1]]), 1.0), tmp_path / "m.yaml", mode="scale"
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": "grey"}, "mode: 'grey'"),
        ({"free_thresh": 0.7}, "free_thresh: 0.7"),
        ({"occupied_thresh": 1.2}, "free_thresh: .* 1.2"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        write_occupancy_grid(random_grid([0]), tmp_path / "m.yaml", **options)
    assert not list(tmp_path.iterdir())


def without(key: str) -> str:
    return "".join(line + "\n" for line in YAML.splitlines() if not line.startswith(key))


@pytest.mark.parametrize(
    ("yaml", "message"),
    [
        *((without(key), f"map.yaml: {key} is missing") for key in
          ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")),
        ("", "map.yaml: image is missing"),
        (YAML.replace("0.05", "0"), "map.yaml: resolution: 0.0 m is not from 0.0001 to"),
        (YAML.replace("0.05", "1e-300"), "map.yaml: resolution: 1e-300 m is not from 0.0001 to"),
        (YAML.replace("0.05", "1e300"), "map.yaml: resolution: 1e.300 m is not from 0.0001 to"),
        (YAML.replace("0.05", "five"), "map.yaml: resolution: 'five' is not a number"),
        (YAML.replace("0.05", ".nan"), "map.yaml: resolution: '.nan' is not a number"),
        (YAML.replace("0.05", "nan"), "map.yaml: resolution: nan is not finite"),
        (YAML.replace("0.05", "[1, 2]"), "map.yaml: resolution: a list is not one value"),
        (YAML.replace(" 0.05", ""), "map.yaml: resolution: nothing is not one value"),
        (YAML.replace(", 0.3", ""), "map.yaml: origin: .* is not \\[x, y, yaw\\]"),
        (YAML.replace("0.3]", "inf]"), "map.yaml: origin: inf is not finite"),
        (YAML.replace("0.3]", "0.3"), "map.yaml: origin: .* is not \\[x, y, yaw\\]"),
        (YAML.replace("0.65", "1.65"), "map.yaml: occupied_thresh: 1.65 is not from 0 to 1"),
        (YAML.replace("0.65", "0.1"), "map.yaml: free_thresh: 0.196 is not below"),
        (YAML.replace("negate: 0", "negate: 2"), "map.yaml: negate: '2' is none of"),
        (YAML + "mode: rough\n", "map.yaml: mode: 'rough' is none of trinary, scale, raw"),
        (YAML + "mode:\n", "map.yaml: mode: nothing is not one value"),
        (YAML + "negate: 1\n", "map.yaml: line 7: negate is there twice"),
        (YAML + "what is this\n", "map.yaml: line 7: 'what is this' is not key: value"),
        (YAML.replace("map.pgm", "''"), "map.yaml: image: '' is no file's name"),
        (YAML.replace("map.pgm", '"a\\q"'), "map.yaml: image: "),
        (YAML.replace("map.pgm", '"\\ud800"'), "map.yaml: image: '.*ud800' is no file's name"),
        (YAML.replace("map.pgm", '"a\\u0000"'), "map.yaml: image: 'a.x00' is no file's name"),
        (YAML.replace("map.pgm", "none.pgm"), "none.pgm: No such file"),
        (YAML.replace("map.pgm", "."), "Is a directory"),
        ("x" * 70000, "map.yaml: over 65536 bytes"),
        ("\x00\xff", "map.yaml: line 1: "),
    ],
)  # fmt: skip
def test_a_bad_yaml_file_is_refused_in_one_line(tmp_path, yaml, message):
    with pytest.raises(OccupancyGridError, match=message) as caught:
        read_occupancy_grid(write(tmp_path, yaml))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"", "not a PGM image"),
        (b"P6\n1 1\n255\n\x00", "not a PGM image"),
        (b"\x89PNG\r\n\x1a\n", "a PNG image; convert it to PGM"),
        (b"P5\n3 2\n", "its header is not width, height and maximum"),
        (b"P5\n3 x\n255\n", "its header is not width, height and maximum"),
        (b"P5\n-3 2\n255\n", "its header is not width, height and maximum"),
        (b"P5\n0 2\n255\n", "width: 0 is not from 1"),
        (b"P5\n3 2\n0\n", "maximum: 0 is not from 1"),
        (b"P5\n3 2\n65536\n", "maximum: 65536 is over 65535"),
        (b"P5\n3 " + b"9" * 5000 + b"\n255\n", "height: 9+ is not from 1"),
        (b"P5\n3 2\n255\n12345", "cut off: 5 bytes of pixels, not 6"),
        (b"P5\n3 2\n255\n1234567", "7 bytes of pixels, not 6"),
        (b"P5\n2 1\n1\n\x00\x02", "pixel at row 0, column 1: 2 is above 1"),
        (b"P2\n3 2\n255\n1 2 3 4 5\n", "9 bytes|10 bytes"),
        (b"P2\n3 2\n255\n1 2 3 4 500 \n", "5 pixels, not 6"),
        (b"P2\n3 2\n255\n1 2 3 4 5 6 7\n", "7 pixels, not 6"),
        (b"P2\n3 2\n255\n1 2 3 4 5 -6\n", "pixels: '-' is not in a number"),
        (b"P2\n3 2\n255\n1 2 3 4 5 " + b"9" * 500, "pixel at row 1, column 2: 65536 is above"),
        (b"P5\n999999999 999999999\n255\n1", "more than"),
    ],
)
def test_a_bad_image_is_refused_in_one_line(tmp_path, image, message):
    with pytest.raises(OccupancyGridError, match=message) as caught:
        read_occupancy_grid(write(tmp_path, image=image))
    assert str(caught.value).startswith(f"{tmp_path / 'map.pgm'}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", [b"P2", b"P5"])
def test_sizes_that_a_file_only_claims_take_no_memory(tmp_path, kind):
    path = write(tmp_path, image=kind + b"\n16384 16384\n65535\n" + b"1 " * 100)
    tracemalloc.start()
    with pytest.raises(OccupancyGridError, match="bytes"):
        read_occupancy_grid(path)
    assert tracemalloc.get_traced_memory()[1] < 4e6
    tracemalloc.stop()


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OccupancyGridError, match=r"nowhere.yaml: No such file"):
        read_occupancy_grid(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("cells", "resolution", "pose", "message"),
    [
        (np.zeros(3), 0.1, [0, 0, 0], r"cells: shape \(3,\)"),
        (np.zeros((0, 3)), 0.1, [0, 0, 0], "cells: shape"),
        ([[0, 101]], 0.1, [0, 0, 0], r"cells\[0, 1\]: 101"),
        ([[np.nan]], 0.1, [0, 0, 0], r"cells\[0, 0\]: nan"),
        ([[0]], 0.0, [0, 0, 0], "resolution: 0.0"),
        ([[0]], 1e-300, [0, 0, 0], "resolution: 1e-300"),
        ([[0]], 1e300, [0, 0, 0], "resolution: 1e.300"),
        ([[0]], np.nan, [0, 0, 0], "resolution: nan"),
        ([[0]], 0.1, [0, np.nan, 0], "T_world_grid: "),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused(cells, resolution, pose, message):
    with pytest.raises(ValueError, match=message):
        OccupancyGrid.make(np.asarray(cells), resolution, pose)


def test_writing_leaves_no_other_file_and_replaces_the_old_one(tmp_path):
    for seed in (1, 2):
        grid = random_grid([-1, 0, 100], seed)
        write_occupancy_grid(grid, tmp_path / "m.yaml")
    np.testing.assert_array_equal(read_occupancy_grid(tmp_path / "m.yaml").cells, grid.cells)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.pgm", "m.yaml"]
