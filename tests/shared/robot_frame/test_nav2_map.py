"""Nav2's maps: what a pixel means in each mode, where a cell lies, and files that are wrong or hostile."""

import math
import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.errors import ConfigError
from surveilnav.geometry import Grid, Pose, base_pose
from surveilnav.robot_frame import Nav2Map, PlanarTransform, load_nav2_map
from surveilnav.robot_frame.nav2_map import FREE, MAX_CELLS, OCCUPIED, UNKNOWN

ENTRIES = (
    "image: m.png\nresolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
)


def written(folder, pixels, entries=ENTRIES, name="m.png"):
    assert cv2.imwrite(str(folder / name), np.asarray(pixels, np.uint8))
    (folder / "map.yaml").write_text(entries.replace("m.png", name))
    return folder / "map.yaml"


@pytest.mark.parametrize("name", ["m.pgm", "m.png", "m.bmp"])
def test_trinary(tmp_path, name):
    grey = [[254, 205, 0], [255, 100, 60]]
    found = load_nav2_map(written(tmp_path, grey, name=name))
    # the picture's lowest row comes first; map_saver's 205 is unknown, though it is brighter than free_thresh
    assert found.cells.tolist() == [[FREE, UNKNOWN, OCCUPIED], [FREE, UNKNOWN, OCCUPIED]]
    assert found.resolution_m == 0.05
    np.testing.assert_allclose(found.places(OCCUPIED), [[-0.875, 2.025], [-0.875, 2.075]])


def test_negate_turns_free_and_occupied_round(tmp_path):
    found = load_nav2_map(written(tmp_path, [[254, 128, 0]], ENTRIES.replace("negate: 0", "negate: 1")))
    assert found.cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


def test_scale_reads_between_the_thresholds_and_what_is_transparent_as_unknown(tmp_path):
    # occupied: 0.02, 0.27 (of 0.25-0.65: 5 %), 0.45 (49 %), 0.63 (94 %), 1; and one that is transparent
    bgra = [
        [[250] * 3 + [255], [186] * 3 + [255], [140] * 3 + [255], [95] * 3 + [255], [0] * 3 + [255], [0] * 3 + [90]]
    ]
    found = load_nav2_map(written(tmp_path, bgra, ENTRIES + "mode: scale\n"))
    assert found.cells.tolist() == [[FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN]]


def test_raw_holds_percents(tmp_path):
    found = load_nav2_map(written(tmp_path, [[0, 25, 40, 65, 100, 101, 255]], ENTRIES + "mode: raw\n"))
    assert found.cells.tolist() == [[FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN]]


def test_the_origin_turns_the_map_about_its_lower_left_corner(tmp_path):
    entries = ENTRIES.replace("0.0]", f"{math.pi / 2}]")
    found = load_nav2_map(written(tmp_path, [[254, 254], [254, 0]], entries))
    np.testing.assert_allclose(found.places(OCCUPIED), [[-1.025, 2.075]], atol=1e-9)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ("", "expected a table with image, resolution and origin"),
        (ENTRIES.replace("resolution: 0.05\n", ""), "resolution is missing"),
        (ENTRIES.replace("0.05", "0"), "resolution is 0"),
        (ENTRIES.replace("0.05", "5"), "a cell of a map is 0.005 to 1 m wide, got 5"),
        (ENTRIES.replace("-1.0", ".nan"), "origin is"),
        (ENTRIES.replace("-1.0", "1e9"), "more than 100 km away"),
        (ENTRIES.replace("0.25", "0.7"), "free_thresh .0.7. must be lower than occupied_thresh .0.65."),
        (ENTRIES + "mode: fancy\n", "line 7: mode is 'fancy'"),
        (ENTRIES.replace("m.png", "none.png"), "there is no file"),
    ],
)
def test_a_file_with_a_mistake(tmp_path, entries, message):
    written(tmp_path, [[0]])
    (tmp_path / "map.yaml").write_text(entries)
    with pytest.raises(ConfigError, match=message):
        load_nav2_map(tmp_path / "map.yaml")


def test_a_small_picture_of_billions_of_pixels_is_never_opened(tmp_path):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    for n in (12_000, 31_000, 60_000):
        header = chunk(b"IHDR", struct.pack(">IIBBBBB", n, n, 8, 0, 0, 0, 0))
        (tmp_path / "m.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", b"") + chunk(b"IEND", b""))
        (tmp_path / "map.yaml").write_text(ENTRIES)
        with pytest.raises(ConfigError, match=f"at most {MAX_CELLS:,} cells"):
            load_nav2_map(tmp_path / "map.yaml")


def message(cells, origin=None, resolution_m=0.05):
    data = np.choose(np.asarray(cells), [-1, 0, 100]).astype(np.int8)
    return Nav2Map.from_message(
        data.shape[1], data.shape[0], resolution_m, origin or Pose.from_matrix(np.eye(4)), data.ravel()
    )


def test_a_message_is_the_same_map_as_its_files(tmp_path):
    cells = np.random.default_rng(1).integers(0, 3, (7, 5))
    grey = np.choose(cells, [205, 254, 0])[::-1]
    from_file = load_nav2_map(written(tmp_path, grey, ENTRIES.replace("0.0]", "0.3]")))
    from_topic = message(cells, Pose.from_matrix(base_pose((-1.0, 2.0, 0.0), 0.3)))
    np.testing.assert_array_equal(from_file.cells, from_topic.cells)
    np.testing.assert_allclose(from_file.places(OCCUPIED), from_topic.places(OCCUPIED))


@pytest.mark.parametrize(
    ("width", "height", "resolution_m", "n", "message"),
    [
        (4, 4, 0.05, 15, "says that it is 4 x 4 cells, and has 15"),
        (0, 4, 0.05, 0, "1 to 50,000,000 cells"),
        (2**31, 2**31, 0.05, 0, "1 to 50,000,000 cells"),
        (2, 2, 0.0, 4, "wide, got 0.0 m"),
        (2, 2, math.nan, 4, "wide, got nan m"),
    ],
)
def test_a_message_that_doesnt_fit(width, height, resolution_m, n, message):
    with pytest.raises(ConfigError, match=message):
        Nav2Map.from_message(width, height, resolution_m, Pose.from_matrix(np.eye(4)), np.zeros(n, np.int8))


def test_a_map_that_leans_is_refused():
    T = np.eye(4)
    T[1:3, 1:3] = [[0.98, -0.199], [0.199, 0.98]]
    with pytest.raises(ConfigError, match="leans"):
        message([[1]], Pose.from_matrix(T))


@given(
    st.builds(PlanarTransform, st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3)), st.sampled_from([0.02, 0.05, 0.1])
)
def test_a_wall_has_no_holes_on_the_grid_of_the_building(T_building_map, resolution_m):
    n = round(4 / resolution_m)
    cells = np.full((n, n), FREE, np.uint8)
    cells[:, n // 2] = OCCUPIED  # from one end to the other
    found = message(cells, resolution_m=resolution_m)
    x0, y0, x1, y1 = found.extent(T_building_map)
    grid = Grid(x0 - 0.5, y0 - 0.5, 0.05, math.ceil((y1 - y0 + 1) / 0.05), math.ceil((x1 - x0 + 1) / 0.05))
    on_grid = found.on_grid(grid, T_building_map)
    # what is free on both sides of the wall isn't connected, and the wall is as long as it was
    n_parts, labels, stats, _ = cv2.connectedComponentsWithStats((on_grid == FREE).astype(np.uint8), connectivity=4)
    assert n_parts - 1 == 2 or sorted(stats[1:, 4])[-3] < 10
    assert labels.max() >= 2
    walls = grid.centres_of(np.argwhere(on_grid == OCCUPIED))
    assert np.ptp(walls @ T_building_map.rotation(), axis=0)[1] > 3.8
    assert np.ptp(walls @ T_building_map.rotation(), axis=0)[0] < resolution_m + 0.12


def test_what_lies_outside_of_the_map_is_unknown():
    found = message([[FREE, OCCUPIED]], resolution_m=0.1).on_grid(Grid(-0.1, -0.1, 0.1, 3, 4), PlanarTransform())
    assert found.tolist() == [[0, 0, 0, 0], [0, FREE, OCCUPIED, 0], [0, 0, 0, 0]]
