"""What tests of the training share: eight small views, a small network."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.sensing.depth_codec import encode_depth
from training.detector import classes
from training.detector.pack import Pack, PackedView, encoded
from training.detector.views import DEPTH_RANGE_M

NAMES = classes.load()


@pytest.fixture(scope="session")
def pack() -> Pack:
    """Eight robot views of 320 x 240 pixels: three coloured boxes each on a grey ramp; the colour is the class.

    The boxes stand 2 m away, in front of a wall at 3 m.
    """
    rng, rows, pictures, id_pictures, depths = np.random.default_rng(4), [], [], [], []
    ramp = np.linspace(90, 160, 320).astype(np.uint8)[None, :, None].repeat(240, axis=0).repeat(3, axis=2)
    colours = np.array([(220, 30, 30), (30, 200, 40), (40, 60, 220)], np.uint8)
    for _ in range(8):
        rgb, ids, boxes, labels, areas = ramp.copy(), np.zeros((240, 320), np.uint8), [], [], []
        for number, column in enumerate((0, 110, 215), start=1):
            w, h = rng.integers(40, 95, 2).tolist()
            x, y = column + int(rng.integers(0, 100 - w + 1)), int(rng.integers(0, 240 - h))
            label = int(rng.integers(3))
            rgb[y : y + h, x : x + w], ids[y : y + h, x : x + w] = colours[label], number
            boxes.append((float(x), float(y), float(x + w), float(y + h)))
            labels.append(label)
            areas.append(w * h)
        rows.append(PackedView("robot", "flat", 1.38, boxes, labels, areas, sorted(set(labels)), 1))
        pictures.append(encoded(rgb[..., ::-1], 90))
        id_pictures.append(encoded(ids))
        depths.append(encode_depth(np.where(ids > 0, 2.0, 3.0), DEPTH_RANGE_M["robot"]))
    return Pack("boxes", NAMES.names, tuple(rows), tuple(pictures), tuple(id_pictures), tuple(depths))
