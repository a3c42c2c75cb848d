"""What one run makes of a view that doesn't change, the next one finds."""

from __future__ import annotations

import pytest

from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.frames import FrameEncoder
from surveilnav.storage import write_parts

SETTINGS = CameraSettings()


@pytest.fixture(autouse=True)
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    return tmp_path


def encoded(camera, quality=85, settings=SETTINGS):
    return FrameEncoder(camera, settings.model_copy(update={"jpeg_quality": quality}))


def test_a_frame_is_encoded_in_one_run_alone(make_camera):
    first, again = make_camera(scene="home"), make_camera(scene="home")
    made = encoded(first).newest(3)
    assert encoded(again).newest(3) == made
    assert (first.asked, again.asked) == ([3], [])


@pytest.mark.parametrize(("scene", "view", "quality"), [("another", 3, 85), ("home", 4, 85), ("home", 3, 60)])
def test_another_home_view_or_quality_is_another_frame(make_camera, scene, view, quality):
    encoded(make_camera(scene="home")).newest(3)
    camera = make_camera(scene=scene)
    encoded(camera, quality).newest(view)
    assert camera.asked == [view]


def test_nothing_is_kept_of_a_real_camera_or_without_room(make_camera, empty_cache):
    encoded(make_camera()).newest(3)
    encoded(make_camera(scene="home"), settings=CameraSettings(disk_cache_mb=0)).newest(3)
    assert not list(empty_cache.rglob("*.kept"))


def test_a_damaged_frame_is_encoded_again(make_camera, empty_cache):
    made = encoded(make_camera(scene="home")).newest(3)
    (file,) = empty_cache.rglob("*.kept")
    file.write_bytes(file.read_bytes()[:-9])
    camera = make_camera(scene="home")
    assert encoded(camera).newest(3) == made
    assert camera.asked == [3]


def test_what_passes_its_checksum_and_means_something_else_is_made_again(make_camera, empty_cache):
    made = encoded(make_camera(scene="home")).newest(3)
    (file,) = empty_cache.rglob("*.kept")
    write_parts(file, b"surveilnav camera 1", [b"a frame of another version"])
    camera = make_camera(scene="home")
    assert encoded(camera).newest(3) == made
    assert camera.asked == [3]
    assert encoded(make_camera(scene="home")).newest(3) == made


def test_a_view_that_changes_while_it_is_encoded_is_not_kept(make_camera, empty_cache):
    camera = make_camera(scene="home")
    latest = camera.latest

    def changing(view):
        picture = latest(view)
        camera.scene = "the same home, later"
        return picture

    camera.latest = changing
    encoded(camera).newest(3)
    assert not list(empty_cache.rglob("*.kept"))


def test_another_program_makes_its_own(make_camera, monkeypatch):
    encoded(make_camera(scene="home")).newest(3)
    monkeypatch.setattr("surveilnav.services.camera_node.result_cache.code_fingerprint", lambda *names: "another")
    camera = make_camera(scene="home")
    encoded(camera).newest(3)
    assert camera.asked == [3]


def test_without_a_cache_frames_are_made_and_not_kept(make_camera, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", "/proc/nope")
    assert encoded(make_camera(scene="home")).newest(3).payload
