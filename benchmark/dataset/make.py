"""A whole dataset: scenes over workers, resumed after a kill, the manifest last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.build import MADE_BY, RULES, build_scene
from surveilnav.benchmark.dataset.format import HabitatFile, Manifest, SceneRecord, SplitCounts
from surveilnav.benchmark.dataset.integrity import damage, damaged_scenes, files_in, files_of, is_whole, read_manifest
from surveilnav.benchmark.dataset.load import load_scene
from surveilnav.benchmark.dataset.splits import SPLITS, SceneSpec, SplitSpec, quotas
from surveilnav.benchmark.play.workers import in_workers
from surveilnav.errors import ConfigError


def make(
    root: Path,
    splits: Sequence[SplitSpec],
    *,
    workers: int,
    anew: bool = False,
    on_progress: Callable[[int, int, str], None] = lambda done, total, scene: None,
) -> Manifest:
    """Builds what is missing, damaged or changed of the splits and writes the manifest of all splits that are whole.

    Args:
        anew: builds what is there, too.

    Raises:
        ConfigError: a dataset of another version is there, files of scenes that a split hasn't, files of a split that isn't
            built were changed, a scene can't be built, or floors, cameras or episodes don't come out as the split says.
    """
    for split in splits:
        _refuse_strays(root, split)
    changed = set() if anew else _changed(root, splits)
    jobs = [
        (root, split.name, spec, n)
        for split in splits
        for spec, n in zip(split.scenes, quotas(split.episodes, len(split.scenes)), strict=True)
        if anew or (split.name, spec.scene) in changed or not is_whole(root, split.name, spec, n)
    ]
    for _, name, spec, _ in jobs:  # whatever stops this build, the next one sees what is still to be built
        (root / name / f"{name}.json.gz").unlink(missing_ok=True)
        (root / name / "scenes" / f"{spec.scene}.json").unlink(missing_ok=True)
    _build(jobs, workers, on_progress)
    for split in splits:
        _check_counts(root, split)
        _write_index(root, split.name)
    return write_manifest(root)


_Job = tuple[Path, str, SceneSpec, int]


def _refuse_strays(root: Path, split: SplitSpec) -> None:
    """Raises ConfigError where a split's folder has files of scenes that it hasn't."""
    own = files_of(split.name, (spec.scene for spec in split.scenes))
    if strays := sorted(files_in(root, split.name) - own):
        more = f" and {len(strays) - 3} more" if len(strays) > 3 else ""
        raise ConfigError(
            f"{root} has files that are none of {split.name}: {', '.join(strays[:3])}{more}; delete them, or take another "
            "--root"
        )


def _changed(root: Path, splits: Sequence[SplitSpec]) -> set[tuple[str, str]]:
    """Splits' scenes whose files aren't what the manifest says: they mustn't get a new hash in it.

    Raises ConfigError where that is so of a split that isn't built now.
    """
    if not (root / "dataset.json").exists():
        return set()
    try:
        manifest = read_manifest(root)
    except ConfigError as error:
        raise ConfigError(f"{error} (`surveilnav dataset build --anew`, or another --root)") from error
    names = {split.name for split in splits}
    for other in sorted(set(manifest.splits) - names):
        if (root / other).exists():  # else somebody has no more use for it
            for name, what in damage(root, manifest, other):
                how = f"build {other} as well" if other in SPLITS else "build it with its --building again"
                raise ConfigError(f"{root / name} {what}: {how}, or delete the split's folder {root / other}")
    return {s for name in names & set(manifest.splits) for s in damaged_scenes(root, manifest, name)}


def _build(jobs: Sequence[_Job], workers: int, on_progress: Callable[[int, int, str], None]) -> None:
    """Raises ConfigError when all others are built, of the scenes that can't be."""
    failed: dict[str, str] = {}
    done = 0
    for ended in in_workers(_work, jobs, workers):
        if ended is not None:
            done, scene = done + 1, ended.job[2].scene
            if ended.error:
                failed[scene] = ended.why
            on_progress(done, len(jobs), scene)
    if failed:
        raise ConfigError("; ".join(f"{scene}: {error}" for scene, error in sorted(failed.items())))


def counts(root: Path, split: str) -> SplitCounts:
    """What a split holds."""
    records = [files.read(p, SceneRecord) for p in sorted((root / split / "scenes").glob("*.json"))]
    contents = [files.read(p, HabitatFile) for p in sorted((root / split / "content").glob("*.json.gz"))]
    return SplitCounts(
        scenes=len(records),
        floors=sum(len(r.floors) for r in records),
        cameras=sum(f.cameras.get("100", 0) for r in records for f in r.floors),
        episodes=sum(len(c.episodes) for c in contents),
    )


def write_manifest(root: Path) -> Manifest:
    """Hashes the files of all splits that are whole, those with an index, and writes ``dataset.json``."""
    whole = [index.parent for index in root.glob("*/*.json.gz") if index.name == f"{index.parent.name}.json.gz"]
    names = sorted(p.relative_to(root).as_posix() for split in whole for p in split.rglob("*.json*") if p.is_file())
    sha256 = {name: files.sha256_of(root / name) for name in names}
    splits = {split.name: counts(root, split.name) for split in sorted(whole)}
    manifest = Manifest(version=files.VERSION, made_by=MADE_BY, rules=RULES, splits=splits, sha256=sha256)
    files.write(root / "dataset.json", manifest)
    return manifest


def _write_index(root: Path, split: str) -> None:
    """The file that Habitat opens first; the episodes lie in ``content/``. Written last: a split that has it is whole."""
    ids = {name: number for number, name in enumerate(files.CATEGORIES)}
    index = HabitatFile(category_to_task_category_id=ids, category_to_scene_annotation_category_id=ids)
    files.write(root / split / f"{split}.json.gz", index)


def _check_counts(root: Path, split: SplitSpec) -> None:
    """Raises ConfigError where the split isn't what it should be: a rule changed, or a building."""
    made = counts(root, split.name)
    if made.episodes != split.episodes:
        for spec, wanted in zip(split.scenes, quotas(split.episodes, len(split.scenes)), strict=True):
            if (there := len(load_scene(root, split.name, spec.scene).content.episodes)) != wanted:
                raise ConfigError(
                    f"{spec.building} should have {wanted} episodes, it came out with {there}: a robot can start to search for "
                    f"too few of {', '.join(files.CATEGORIES.values())} there; take fewer --episodes, or leave the building out"
                )
    floors, cameras = split.expected or (made.floors, made.cameras)
    if (made.floors, made.cameras, made.episodes) != (floors, cameras, split.episodes):
        raise ConfigError(
            f"{split.name} should have {floors} floors, {cameras} cameras and {split.episodes} episodes, it came out with "
            f"{made.floors}, {made.cameras} and {made.episodes}"
        )


def _work(job: _Job) -> None:
    try:
        build_scene(*job)
    except OSError as error:  # a full disk
        raise ConfigError(str(error)) from error
