from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.camera_node.core.lease import choose_camera, keeps_camera

names = st.sampled_from("abcdefghij")


@given(st.sets(names), st.lists(names, unique=True), st.text(min_size=1, max_size=8))
def test_a_camera_is_free_and_exists(taken: set[str], cameras: list[str], node: str) -> None:
    camera = choose_camera(cameras, taken, node)
    if camera is None:
        assert set(cameras) <= taken
    else:
        assert camera in set(cameras) - taken
        assert camera == choose_camera(cameras, taken, node)


def test_replicas_begin_at_different_cameras_and_one_of_two_rivals_yields() -> None:
    assert len({choose_camera("abcdefgh", set(), f"node-{k}") for k in range(20)}) > 4
    assert keeps_camera("a", ["b", "c"])
    assert not keeps_camera("b", ["a"])
    assert keeps_camera("a", [])
    assert sum(keeps_camera(me, [n for n in "abc" if n != me]) for me in "abc") == 1
