"""A run: the same twice, resumed, nothing broken counted."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from surveilnav.benchmark import canary
from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.load import load_scene, start_of
from surveilnav.benchmark.dataset.make import make, write_manifest
from surveilnav.benchmark.dataset.splits import SceneSpec, SplitSpec
from surveilnav.benchmark.explain.loss import loss_of
from surveilnav.benchmark.play.approach import NEAR_M
from surveilnav.benchmark.play.episode import REASONS, Episode, FusedCameras
from surveilnav.benchmark.play.sight import Sight
from surveilnav.benchmark.policies import policy_of
from surveilnav.benchmark.policies.language_model import ANSWERS_FILE
from surveilnav.benchmark.runner import play
from surveilnav.benchmark.runner.basis import basis_of
from surveilnav.benchmark.runner.play import ScenePlayer
from surveilnav.benchmark.runner.records import Records
from surveilnav.benchmark.runner.run import _work, run, some_of
from surveilnav.benchmark.runner.search import search
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError
from surveilnav.robot_state import RobotState
from surveilnav.simulator.truth.choose import choose_backend

SETTINGS = RunSettings(perception="oracle", max_steps=40)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, made_once):
    """A copy: some tests edit it and put it right after."""
    return Path(shutil.copytree(made_once("run-dataset", _make), tmp_path_factory.mktemp("runs") / "dataset"))


def _make(root):
    scenes = (SceneSpec("parametric_flat", 0, "all"), SceneSpec("parametric_house", 0, "all"))
    make(root, [SplitSpec("val_mini", scenes, 6)], workers=1)


def _plain(records):
    return [msgspec.structs.replace(r, seconds=0.0) for r in records]


@pytest.fixture(scope="module")
def finished(dataset, tmp_path_factory):
    return run(dataset, tmp_path_factory.mktemp("run"), SETTINGS, workers=2)


def test_every_episode_is_played_once(finished):
    assert finished.complete
    assert len({r.key for r in finished.records}) == len(finished.records) == 6
    assert finished.broken == []
    assert finished.unopened == {}
    assert all((r.reason == "") == r.success for r in finished.records)
    assert all(r.reason in {"", *REASONS} for r in finished.records)
    assert any(r.success for r in finished.records)
    assert all(r.bytes["jpeg+depth"] > 0 for r in finished.records)


def test_the_same_twice_on_any_number_of_workers(dataset, finished, tmp_path):
    assert _plain(run(dataset, tmp_path, SETTINGS, workers=1).records) == _plain(finished.records)


def test_a_second_start_plays_what_is_missing(dataset, finished, tmp_path, monkeypatch):
    records = Records(tmp_path, SETTINGS, basis_of(dataset, "val_mini"))
    for record in finished.records[:-2]:
        records.add(record)
    again = run(dataset, tmp_path, SETTINGS, workers=1)
    assert _plain(again.records) == _plain(finished.records)
    assert [r.seconds for r in again.records[:-2]] == [r.seconds for r in finished.records[:-2]]  # not played again


def test_some_of_each_scene_are_played_and_later_the_rest(dataset, finished, tmp_path):
    said = []
    few = run(dataset, tmp_path, SETTINGS, workers=2, per_scene=1, on_progress=said.append)
    assert len({r.scene for r in few.records}) == len(few.records) == 2
    assert few.complete
    assert (said[-1].done, said[-1].total) == (2, 2)
    whole = run(dataset, tmp_path, SETTINGS, workers=2)
    assert _plain(whole.records) == _plain(finished.records)
    keys = {r.key for r in few.records}
    assert [r.seconds for r in whole.records if r.key in keys] == [r.seconds for r in few.records], "not played again"
    assert run(dataset, tmp_path, SETTINGS, workers=2, per_scene=1).complete, "more is there than was asked for"


def test_some_episodes_are_spread_over_the_scene():
    ids = [f"{i:02}" for i in range(28)]
    for scene in ("flats_0-s0", "office_3-s0", "studio-s1"):
        few, more = some_of(scene, ids, 4), some_of(scene, ids, 8)
        assert len(few) == len(set(few)) == 4
        assert few == sorted(few)
        assert set(few) < set(more)
        gaps = [int(b) - int(a) for a, b in zip(few, [*few[1:], f"{int(few[0]) + 28}"], strict=True)]
        assert gaps == [7, 7, 7, 7]
        assert some_of(scene, ids, 28) == some_of(scene, ids, 99) == ids
    assert len({tuple(some_of(f"flats_{n}-s0", ids, 4)) for n in range(20)}) > 4, (
        "not of the same category in each scene"
    )
    assert some_of("flats_0-s0", [], 4) == []


def test_a_broken_episode_is_named_and_not_counted(dataset, tmp_path, monkeypatch):
    real = ScenePlayer.play

    def sometimes(self, episode):
        if episode.episode_id == "1":
            raise ZeroDivisionError("a bug")
        return real(self, episode)

    monkeypatch.setattr(ScenePlayer, "play", sometimes)
    basis = basis_of(dataset, "val_mini")
    play.play_scene(dataset, tmp_path, basis, SETTINGS, "parametric_flat-s0", frozenset({"0", "1"}))
    records = Records(tmp_path, SETTINGS, basis)
    assert [r.episode_id for r in records.all()] == ["0"]
    assert "a bug" in records.broken()[0].error


def test_a_run_is_stamped_with_what_the_program_does(dataset, finished, tmp_path, monkeypatch):
    """With the digest of the golden run: a program that is written otherwise and searches alike goes on with a run."""
    basis = basis_of(dataset, "val_mini")
    assert basis.program == canary.digest()
    records = Records(tmp_path, SETTINGS, basis)
    records.add(finished.records[0])
    monkeypatch.setattr("surveilnav.benchmark.runner.basis.digest", lambda: "another")
    with pytest.raises(ConfigError, match="a program that searches otherwise"):
        run(dataset, tmp_path, SETTINGS, workers=1)


def test_a_worker_doesnt_go_on_by_another_program(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr("surveilnav.benchmark.runner.run.digest", lambda: "another")
    with pytest.raises(ConfigError, match="changed since this run began"):
        _work((dataset, tmp_path, basis_of(dataset, "val_mini"), SETTINGS, "parametric_flat-s0", frozenset({"0"})))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def edited(dataset):
    """``edited(manifest)`` names a building that isn't in a scene's file, and mends the manifest if asked; put right after."""
    path = dataset / "val_mini" / "scenes" / "parametric_flat-s0.json"
    kept = path.read_text()

    def edit(manifest):
        path.write_text(kept.replace('"parametric_flat"', '"parametric_castle"'))
        if manifest:
            write_manifest(dataset)

    yield edit
    path.write_text(kept)
    write_manifest(dataset)


def test_a_scene_that_cant_be_opened_is_named(dataset, edited, tmp_path):
    edited(manifest=True)
    finished = run(dataset, tmp_path, SETTINGS, workers=1)
    assert not finished.complete
    assert "parametric_castle" in finished.unopened["parametric_flat-s0"]
    assert len(finished.records) == 3


def test_files_that_the_manifest_doesnt_know_arent_played(dataset, edited, tmp_path):
    edited(manifest=False)
    with pytest.raises(ConfigError, match=r"parametric_flat-s0.json was changed.*dataset check"):
        run(dataset, tmp_path, SETTINGS, workers=1)


def test_a_density_that_isnt_there_is_said_before_anything_is_kept(dataset, tmp_path):
    with pytest.raises(ConfigError, match="cameras per 100, 200 m2, not per 150"):
        run(dataset, tmp_path / "run", msgspec.structs.replace(SETTINGS, density_m2=150), workers=1)
    assert not (tmp_path / "run").exists()


def test_fused_once_is_as_good_as_fused_live(dataset):
    """The shortcut of the benchmark changes nothing that the planner sees."""
    player = ScenePlayer(dataset, "parametric_house-s0", SETTINGS)
    shown = []

    def look(step, view, joint, maps, decision):
        shown.append(
            (decision.action, maps.occupancy.tobytes(), maps.explored.tobytes(), maps.value.tobytes(), maps.objects)
        )

    episode = player.episodes[0]
    label = player._data.label_of(episode)
    building = player._sight.building
    goals, start = player._data.goals(label, building.scene, building.navigation), start_of(episode, building.scene)
    settings = msgspec.structs.replace(SETTINGS, max_steps=12, views_per_step=0)
    runs = []
    for fused in (FusedCameras(player._sight, settings.fusion_config()), None):
        shown.clear()
        for _ in range(2 if fused else 1):  # the second time from the copy
            shown.clear()
            search(player._sight, settings, goals, start, seed=1, fused=fused, on_step=look)
        runs.append(list(shown))
    assert runs[0] == runs[1]


def test_searches_are_told_that_they_begin_on_a_floor_with_a_goal(dataset, monkeypatch):
    player = ScenePlayer(dataset, "parametric_house-s0", SETTINGS)
    told = []
    ours = policy_of(SETTINGS.policy)
    watched = replace(ours, begin=lambda task: told.append(task) or ours.begin(task))
    monkeypatch.setattr("surveilnav.benchmark.runner.search.policy_of", lambda name: watched)
    player.play(player.episodes[0])
    assert [task.goal_on_floor for task in told] == [True]


def test_bytes_are_those_of_the_rendered_views(dataset, monkeypatch):
    """Nothing is rendered for `simulated`; what its cameras offered was measured once, and is what pixels would take."""
    results, real = [], Episode.run
    monkeypatch.setattr(Episode, "run", lambda self: results.append(real(self)) or results[-1])
    data = load_scene(dataset, "val_mini", "parametric_house-s0")
    measured = data.cameras.view_bytes["100"]
    player = ScenePlayer(dataset, "parametric_house-s0", SETTINGS)
    for episode in player.episodes:
        record = player.play(episode)
        invoked = results[-1].camera_bytes
        assert invoked
        assert record.bytes["jpeg+depth"] == sum(sum(measured[camera]) for camera in invoked)
    building = open_scene(data.record, lighting="flat")
    camera = building.plan.cameras[0].name
    sight = Sight(building, choose_backend("oracle"), plan=data.plan(100))
    rendered = [seen.offered_bytes for seen in sight.camera(camera)]  # by way of the view cache, whose depth is rounded
    assert rendered == pytest.approx(measured[camera], rel=0.01)


def test_no_such_split_or_dataset(dataset, tmp_path):
    with pytest.raises(ConfigError, match="has the splits val_mini"):
        run(dataset, tmp_path, RunSettings(split="test"), workers=1)
    with pytest.raises(ConfigError, match="dataset build"):
        run(tmp_path / "none", tmp_path / "out", RunSettings(), workers=1)


# --- what explains a search ---------------------------------------------------------------------------------------


def test_records_say_how_near_a_search_came_and_what_cameras_knew(dataset, finished, tmp_path):
    """Cameras with the true detector know surely what they see; without cameras nothing is known."""
    for r in finished.records:
        assert r.approach.closest_m <= (r.distance_m if r.distance_m is not None else np.inf) + 1e-3
        assert r.approach.closest_m <= r.shortest_path_m + 1e-3
        assert r.approach.came_near == (r.approach.closest_m <= NEAR_M)
        assert r.approach.last_near_path_m is None or r.distance_m <= NEAR_M
        assert r.camera_chance == 0.0 or r.camera_chance > 0.9
        assert sum(loss_of(r)) == pytest.approx(1.0 - r.spl)
    assert any(r.camera_chance > 0.9 for r in finished.records)
    alone = run(dataset, tmp_path, msgspec.structs.replace(SETTINGS, surveillance=False), workers=1, per_scene=1)
    assert [r.camera_chance for r in alone.records] == [None, None]


def test_what_cameras_knew_is_asked_without_changing_the_maps(dataset):
    player = ScenePlayer(dataset, "parametric_flat-s0", SETTINGS)
    player.play(player.episodes[0])
    fused, (names,) = player._fused, player._fused._kept
    before = fused.maps_of(names)
    fused.chance_at_goal(next(iter(player._goals.values())), 0.0)
    assert list(fused._kept) == [names]
    assert fused.maps_of(names).objects("0") == before.objects("0")


def test_an_oracle_on_the_cameras_alone_leaves_the_robots_eyes_as_they_are(dataset):
    """What things are in the cameras' views is told by the truth. The embeddings of these views are the same."""
    settings = RunSettings(perception="simulated", max_steps=1)
    own = ScenePlayer(dataset, "parametric_flat-s0", settings)
    told = ScenePlayer(dataset, "parametric_flat-s0", msgspec.structs.replace(settings, camera_perception="oracle"))
    camera = own._sight.infos[0].camera
    scores = set()
    for plain, perfect in zip(own._sight.camera(camera), told._sight.camera(camera), strict=True):
        if plain.perception is not None:
            assert perfect.perception.embedding_model == plain.perception.embedding_model
            assert perfect.perception.image_embedding.tobytes() == plain.perception.image_embedding.tobytes()
            assert {d.score for d in plain.perception.detections} != {1.0}
            scores |= {d.score for d in perfect.perception.detections}
    assert scores == {1.0}
    state = RobotState(1.0, 1.0, 0.0, "0", 0.0)
    views = [player._sight.robot(state).perception for player in (own, told)]
    assert [d.score for d in views[0].detections] == [d.score for d in views[1].detections]
    assert views[0].image_embedding.tobytes() == views[1].image_embedding.tobytes()


def test_an_oracle_on_the_cameras_needs_cameras():
    with pytest.raises(ConfigError, match="none take part"):
        RunSettings(camera_perception="oracle", surveillance=False).check()
    with pytest.raises(ConfigError, match=r"camera_perception is one of , oracle, got 'compact'"):
        RunSettings(camera_perception="compact").check()


def test_a_run_that_asks_a_language_model_says_what_it_cost(dataset, tmp_path, server, monkeypatch):
    """Played again in another folder with the same answers, it takes the same steps and asks nothing."""
    monkeypatch.setenv("SURVEILNAV_LLM__URL", server.url)

    def answer(asked):
        n = len(asked["messages"][1]["content"].splitlines()) - 2
        scores = [i / n for i in range(n)]  # the farthest
        usage = {"prompt_tokens": 100, "completion_tokens": 10}
        return json.dumps({"choices": [{"message": {"content": json.dumps({"scores": scores})}}], "usage": usage})

    server.body = answer
    settings = msgspec.structs.replace(SETTINGS, policy="llm", language_model="tiny", surveillance=False)
    finished = run(dataset, tmp_path / "run", settings, workers=1)
    assert finished.complete
    n = len(server.asked)
    assert 0 < n == finished.cost.asked
    assert (finished.cost.prompt_tokens, finished.cost.completion_tokens, finished.cost.failed) == (100 * n, 10 * n, {})
    (tmp_path / "again").mkdir()
    shutil.copy(tmp_path / "run" / ANSWERS_FILE, tmp_path / "again")
    again = run(dataset, tmp_path / "again", settings, workers=1)
    assert _plain(again.records) == _plain(finished.records)
    assert len(server.asked) == n
    assert again.cost.asked == n
    assert again.cost.cached >= n


def test_a_tier_needs_pictures_and_has_to_exist():
    with pytest.raises(ConfigError, match="leave camera_tier"):
        RunSettings(camera_tier="features").check()
    with pytest.raises(ConfigError, match="camera_tier is one of raw, jpeg"):
        RunSettings(camera_tier="auto", perception="compact").check()
    RunSettings(camera_tier="features", perception="compact").check()
