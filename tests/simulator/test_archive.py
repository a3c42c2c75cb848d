from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator import archive
from surveilnav.simulator.archive import Archive, decode_picture, picture_size


def write(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


def test_members_are_found_whatever_their_case(tmp_path: Path) -> None:
    with Archive(write(tmp_path / "a.zip", {"Folder/Model.OBJ": b"x"})) as it:
        assert it.read("folder/model.obj") == b"x"
        assert it.read("/Folder/Model.OBJ") == b"x"
        assert it.read("other") is None
        assert it.fingerprint("FOLDER/MODEL.OBJ") != ""
        assert it.fingerprint("other") == ""


@pytest.mark.parametrize("name", ["../evil", "a/../../evil", "/etc/passwd", "..\\evil", "C:\\evil"])
def test_names_that_climb_out_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(BuildingError, match="points outside"):
        Archive(write(tmp_path / "a.zip", {name: b"x"}))


def test_a_bomb_by_ratio_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BuildingError, match="zip bomb"):
        Archive(write(tmp_path / "a.zip", {"Home.xml": b"\0" * (8 << 20)}))


def test_a_bomb_by_sum_or_count_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.zip", {f"{i}": b"x" * 100 for i in range(20)})
    monkeypatch.setattr(archive, "MAX_TOTAL_BYTES", 1000)
    with pytest.raises(BuildingError, match="zip bomb"):
        Archive(path)
    monkeypatch.undo()
    monkeypatch.setattr(archive, "MAX_MEMBERS", 10)
    with pytest.raises(BuildingError, match="more than 10"):
        Archive(path)


def test_a_member_larger_than_it_says_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.zip", {"Home.xml": b"<home/>" * 1000})
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\x01\x02")
    data[at + 24 : at + 28] = struct.pack("<I", 10)  # the central directory lies about the size
    path.write_bytes(data)
    with Archive(path) as it, pytest.raises(BuildingError, match=r"damaged|larger than it says"):
        it.read("Home.xml")


@pytest.mark.parametrize("cut", [0, 10, 60, 200])
def test_no_zip_and_cut_short(tmp_path: Path, cut: int) -> None:
    whole = write(tmp_path / "a.zip", {"Home.xml": np.random.default_rng(0).bytes(400)}).read_bytes()
    (tmp_path / "b.zip").write_bytes(whole[:cut])
    with pytest.raises(BuildingError, match="cut short"):
        Archive(tmp_path / "b.zip")


def test_damaged_content_is_named(tmp_path: Path) -> None:
    path = write(tmp_path / "a.zip", {"Home.xml": np.random.default_rng(0).bytes(4000)})
    data = bytearray(path.read_bytes())
    data[1000] ^= 0xFF
    path.write_bytes(data)
    with Archive(path) as it, pytest.raises(BuildingError, match="damaged"):
        it.read("Home.xml")


def test_pictures_are_made_smaller_and_keep_their_colours() -> None:
    picture = np.zeros((40, 1100, 3), np.uint8)
    picture[..., 2] = 200  # red in OpenCV's order
    for kind in (".png", ".jpg", ".bmp"):
        data = cv2.imencode(kind, picture)[1].tobytes()
        assert picture_size(data) == (1100, 40)
        decoded = decode_picture(data)
        assert decoded is not None
        assert decoded[0].shape == (19, 512, 3)
        assert decoded[1] is None
        assert abs(int(decoded[0][5, 5, 0]) - 200) < 5


def test_opacity_comes_apart() -> None:
    picture = np.full((8, 8, 4), 255, np.uint8)
    picture[:4, :, 3] = 0
    decoded = decode_picture(cv2.imencode(".png", picture)[1].tobytes())
    assert decoded is not None
    assert decoded[1] is not None
    assert (decoded[1][:4] == 0).all()
    assert (decoded[1][4:] == 255).all()


def test_picture_bombs_and_noise_are_no_pictures() -> None:
    huge = (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + struct.pack(">II", 60_000, 60_000) + b"\x08\x02\0\0\0"
    )
    assert picture_size(huge) is None
    assert decode_picture(huge) is None
    rng = np.random.default_rng(0)
    for start in (b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"BM"):
        for _ in range(50):
            assert decode_picture(start + rng.bytes(60)) is None
