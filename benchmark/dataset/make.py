"""A whole dataset: scenes over workers, resumed after a kill, the manifest last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from benchmark.dataset import format as files
from benchmark.dataset.build import MADE_BY, RULES, build_scene
from benchmark.dataset.format import HabitatFile, Manifest, SceneRecord, SplitCounts
from benchmark.dataset.splits import SceneSpec, SplitSpec, quotas
from benchmark.workers import worker_pool
from surveilnav.errors import ConfigError, SurveilNavError


def make(
    root: Path,
    splits: Sequence[SplitSpec],
    *,
    workers: int,
    on_progress: Callable[[int, int, str], None] = lambda done, total, scene: None,
) -> Manifest:
    """Builds what is missing of the splits and writes the manifest of all that is there.

    Raises:
        ConfigError: a scene can't be built, or floors, cameras or episodes don't come out as the split says.
    """
    jobs = [
        (root, split.name, spec, n)
        for split in splits
        for spec, n in zip(split.scenes, quotas(split.episodes, len(split.scenes)), strict=True)
        if not (root / split.name / "scenes" / f"{spec.scene}.json").exists()
    ]
    failed: dict[str, str] = {}
    if jobs:
        with worker_pool(min(workers, len(jobs))) as pool:
            for done, (scene, error) in enumerate(pool.imap_unordered(_work, jobs), start=1):
                if error:
                    failed[scene] = error
                on_progress(done, len(jobs), scene)
    if failed:
        raise ConfigError("; ".join(f"{scene}: {error}" for scene, error in sorted(failed.items())))
    for split in splits:
        _write_index(root, split.name)
        _check_counts(root, split)
    return write_manifest(root)


def counts(root: Path, split: str) -> SplitCounts:
    """What a split holds."""
    records = [files.read(p, SceneRecord) for p in sorted((root / split / "scenes").glob("*.json"))]
    contents = [files.read(p, HabitatFile) for p in sorted((root / split / "content").glob("*.json.gz"))]
    return SplitCounts(
        scenes=len(records),
        floors=sum(len(r.floors) for r in records),
        cameras=sum(f.cameras["100"] for r in records for f in r.floors),
        episodes=sum(len(c.episodes) for c in contents),
    )


def write_manifest(root: Path) -> Manifest:
    """Hashes all files and writes ``dataset.json``."""
    names = sorted(p.relative_to(root).as_posix() for p in root.glob("*/**/*.json*") if p.is_file())
    manifest = Manifest(
        version=files.VERSION, made_by=MADE_BY, rules=RULES,
        splits={name: counts(root, name) for name in sorted({n.partition("/")[0] for n in names})},
        sha256={name: files.sha256_of(root / name) for name in names},
    )  # fmt: skip
    files.write(root / "dataset.json", manifest)
    return manifest


def _write_index(root: Path, split: str) -> None:
    """The file that Habitat opens first; the episodes lie in ``content/``."""
    ids = {name: number for number, name in enumerate(files.CATEGORIES)}
    index = HabitatFile(category_to_task_category_id=ids, category_to_scene_annotation_category_id=ids)
    files.write(root / split / f"{split}.json.gz", index)


def _check_counts(root: Path, split: SplitSpec) -> None:
    """Raises ConfigError where the split isn't what it should be: a rule changed, or a building."""
    made = counts(root, split.name)
    floors, cameras = split.expected or (made.floors, made.cameras)
    if (made.floors, made.cameras, made.episodes) != (floors, cameras, split.episodes):
        raise ConfigError(
            f"{split.name} should have {floors} floors, {cameras} cameras and {split.episodes} episodes, it came out with "
            f"{made.floors}, {made.cameras} and {made.episodes}"
        )


def _work(job: tuple[Path, str, SceneSpec, int]) -> tuple[str, str]:
    root, split, spec, n = job
    try:
        build_scene(root, split, spec, n)
    except (SurveilNavError, OSError) as error:
        return spec.scene, str(error)
    return spec.scene, ""
