"""The file of mask zones: what it says, what is refused, and which pixels a zone touches."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from surveilnav.errors import ConfigError
from surveilnav.geometry.polygon import pixels_in
from surveilnav.services.camera_node.zones import read_zones

SQUARE = [[0.2, 0.2], [0.6, 0.2], [0.6, 0.6], [0.2, 0.6]]


@pytest.fixture
def written(tmp_path):
    """``written(value)``: a file that holds it, as JSON (which is YAML) unless it is text."""

    def write(value):
        path = tmp_path / "masks.yaml"
        path.write_text(value if isinstance(value, str) else json.dumps(value))
        return path

    return write


def test_zones_by_view(written):
    path = written(
        "hall:\n  all:\n    - [[0, 0], [1, 0], [1, 0.1]]\n  3:\n    - [[0.2, 0.5], [0.6, 0.5], [0.4, 0.9]]\nroof: {}\n"
    )
    zones = read_zones(path, "hall", 5)
    assert {v: len(z) for v, z in zones.items()} == {0: 1, 1: 1, 2: 1, 3: 2, 4: 1}
    assert zones[3][1] == ((0.2, 0.5), (0.6, 0.5), (0.4, 0.9))
    assert read_zones(path, "roof", 5) == {}
    assert read_zones(path, "garden", 5) == {}
    assert read_zones(written("{}"), "hall", 5) == {}


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("hall: [", "isn't YAML"),
        ("hall: {all: []}\nhall: {all: []}", "'hall' stands there twice"),
        ("hall: {1: [], '1': []}", "'1' stands there twice"),
        ("[1, 2]", "expected a table of cameras"),
        ("", "expected a table of cameras"),
        ("# nothing\n", "expected a table of cameras"),
        ("[]", "expected a table of cameras"),
        ("false", "expected a table of cameras"),
        ({"hall": [SQUARE]}, "camera hall: expected a table of views"),
        ({"hall": {"13": [SQUARE]}}, "view 13: expected 'all' or a view of 0-4"),
        ({"hall": {"-1": [SQUARE]}}, "expected 'all' or a view of 0-4"),
        ({"hall": {"0": SQUARE}}, "zone 1, corner|zone 1: a corner is|expected 3 to 100 corners"),
        ({"hall": {"0": 7}}, "expected a list of at most 100 zones"),
        ({"hall": {"0": [SQUARE] * 101}}, "expected a list of at most 100 zones"),
        ({"hall": {"0": [SQUARE[:2]]}}, "view 0, zone 1: expected 3 to 100 corners"),
        ({"hall": {"0": [SQUARE, SQUARE * 26]}}, "zone 2: expected 3 to 100 corners"),
        ({"hall": {"0": [[[0, 0], [0.5, 0.5], [1, 1]]]}}, "lie on one line"),
        ({"hall": {"0": [[[0, 0], [0, 0], [0, 0]]]}}, "lie on one line"),
        ({"hall": {"0": [[[0, 0], [1, 1], [1, 0], [0, 0.9]]]}}, "sides 1 and 3 cross"),
        ({"hall": {"0": [[[0, 0], [640, 0], [640, 480]]]}}, "For pixels, divide by"),
        ({"hall": {"0": [[[0, -0.01], [1, 0], [1, 1]]]}}, "from 0 .left, top. to 1"),
        ("hall: {0: [[[0, .nan], [1, 0], [1, 1]]]}", "from 0"),
        ({"hall": {"0": [[[0, True], [1, 0], [1, 1]]]}}, "from 0"),
        ({"hall": {"0": [[[0, "0"], [1, 0], [1, 1]]]}}, "from 0"),
        ({"hall": {"0": [[[0, 0, 0], [1, 0], [1, 1]]]}}, "from 0"),
        ({"hal": {"0": [SQUARE]}}, "there is no camera 'hal'; there are hall, roof"),
        ("hall: &a {0: *a}", "expected a list"),
        ("!!python/object/apply:os.system ['true']", "isn't YAML"),
        ("x" * (1 << 20) + "x", "at most 1048576 bytes"),
    ],
)
def test_what_cant_be_meant_is_refused_whole(written, value, words):
    with pytest.raises(ConfigError, match=words):
        read_zones(written(value), "hall", 5, ["hall", "roof"])


def test_a_file_that_isnt_there_is_no_empty_one(tmp_path):
    with pytest.raises(ConfigError, match="can't be read"):
        read_zones(tmp_path / "none.yaml", "hall", 5)


UNIT = st.floats(0, 1)
TRIANGLES = st.tuples(*[st.tuples(UNIT, UNIT)] * 3)


@given(TRIANGLES, st.integers(1, 70), st.integers(1, 70), st.lists(st.tuples(UNIT, UNIT), min_size=30, max_size=30))
@example(((0.0, 1.0), (0.0, 1.0), (0.0, 1.0)), 1, 1, [(0.0, 0.0)] * 30)
def test_every_pixel_that_a_zone_touches_is_masked(triangle, width, height, places):
    """Any place in the triangle lies on a masked pixel, also in slivers thinner than a pixel."""
    mask = pixels_in([triangle], width, height)
    a, b, c = np.array(triangle)
    for s, t in places:
        if s + t > 1:
            s, t = 1 - s, 1 - t
        x, y = a + s * (b - a) + t * (c - a)
        assert mask[min(int(y * height), height - 1), min(int(x * width), width - 1)]


@given(TRIANGLES, TRIANGLES)
def test_zones_that_overlap_hide_what_each_hides(first, second):
    both = pixels_in([first, second], 40, 30)
    assert np.array_equal(both, pixels_in([first], 40, 30) | pixels_in([second], 40, 30))


def test_a_zone_hides_little_beyond_itself():
    mask = pixels_in([((0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75))], 40, 40)
    rows, cols = np.nonzero(mask)
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (9, 31, 9, 31)  # 10-29, and a pixel or two around
    assert not pixels_in([((0, 0), (0.1, 0), (0, 0.1))], 40, 40)[10:, 10:].any()
    assert pixels_in([((0, 0), (1, 0), (1, 1), (0, 1))], 40, 40).all()
