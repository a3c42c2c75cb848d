"""The two pages of settings, from the classes that read them: docs/use/settings.md has those that people need, and
docs/use/settings-expert.md all others.

python -m surveilnav.cli.settings_page docs/use    # make docs: writes both into that folder
"""

from __future__ import annotations

import math
import re
import sys
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings

from surveilnav.benchmark.policies.language_model import LanguageModelSettings
from surveilnav.bus import BusSettings
from surveilnav.pictures import PictureSettings
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.simulator.hardware.config import CameraHardwareSettings, RobotHardwareSettings
from surveilnav.simulator.simulation import SimulationSettings

_BEGINNING = """\
# Settings

Generated from the settings classes by `make docs`; don't edit.

These are the settings that most people need. Every setting is an environment variable. Lists and tables are written in JSON,
yes and no as `true` and `false`. If a value is invalid, the process ends with one line that says what was expected.

```
SURVEILNAV_GATEWAY__PORT=8090 SURVEILNAV_BUS__LOG_LEVEL=debug surveilnav up
SURVEILNAV_FUSION__PRESET=paper surveilnav demo               # joint maps to the letter of the paper
```

`surveilnav up` and `surveilnav demo` set the bus, the building, seed, cameras, perception and stores by their options (see
`--help`). For these they ignore the environment; only the folder of recordings is taken from it.

[Experts' settings](settings-expert.md) has all other settings: numbers of the maps and the planner, time-outs, limits.

## Folders and addresses

| variable | default | what |
|---|---|---|
| `SURVEILNAV_CACHE_DIR` | `~/.cache/surveilnav` | what can be computed or downloaded again: furniture, light, views, frames |
| `SURVEILNAV_MODELS_DIR` | not set | a folder with [models](models.md) |
| `SURVEILNAV_OFFLINE` | not set | `1`: no model is ever downloaded |
| `SURVEILNAV_YOLO_WORLD` | not set | the ONNX file that you exported for the model `yolo-world` |
| `HF_HUB_OFFLINE` | not set | `1`: the same; other programs that use the Hugging Face hub know this variable |
| `HF_ENDPOINT` | `https://huggingface.co` | the hub that models are pulled from, or a mirror of it |
| `SURVEILNAV_API_KEY` | not set | the key that these commands and the Python client send, where the gateway needs one |
| `SURVEILNAV_URL` | `http://127.0.0.1:8080` | the gateway that commands such as `surveilnav find` and `surveilnav status` ask |
"""

_EXPERT_BEGINNING = """\
# Experts' settings

Generated from the settings classes by `make docs`; don't edit.

These are all settings that aren't on [the page of settings](settings.md). They are environment variables as well. The published
results were measured with their defaults. If you change one, know why, and measure again.

```
SURVEILNAV_PLANNER__CORE__STRATEGY=greedy surveilnav up       # one number of the planner's core
SURVEILNAV_PLANNER__CORE='{"second_look_m": null}' surveilnav up    # None is null in JSON
```

- A misspelt name is an error if it belongs to a part (`FUSION__MAP__...`, `PLANNER__CORE__...`). Elsewhere it is ignored.
- A description that begins with `...` continues the one in the row above.
"""

#: What people need, by the part of the variable after ``SURVEILNAV_``. Whatever isn't here is an expert's.
_COMMON = {
    "BUS": ("ROUTER", "LOG_FORMAT", "LOG_LEVEL"),
    "PICTURES": ("KEEP_H",),
    "SIM": ("BUILDING", "SEED", "CAMERAS"),
    "CAMERA": ("FILE", "ID", "MASKS", "PERCEPTION"),
    "ROBOT": ("ID", "START"),
    "PERCEPTION": ("BACKEND", "DEVICE", "DOWNLOAD"),
    "FUSION": ("SURVEILLANCE", "PRESET", "STORE", "PROMPTS"),
    "PLANNER": ("STORE",),
    "GATEWAY": ("HOST", "PORT", "ALLOWED_HOSTS", "ROOT_PATH", "ACCESS_LOG", "KEYS_FILE"),
    "RECORDER": ("FOLDER", "MAX_MB", "MAX_DAYS"),
}
COMMON = frozenset(f"SURVEILNAV_{part}__{name}" for part, names in _COMMON.items() for name in names)


@dataclass(frozen=True, slots=True)
class Section:
    """A heading of the pages and the classes below it. ``config``: what the settings class takes as free tables."""

    title: str
    module: str
    settings: type[BaseSettings]
    config: type[BaseModel] | None = None


SECTIONS = (
    Section("The bus: every process", "shared/surveilnav/bus/settings.py", BusSettings),
    Section("Past pictures: fusion and demo", "shared/surveilnav/pictures.py", PictureSettings),
    Section("The simulated building", "simulator/simulation.py", SimulationSettings),
    Section("The simulated ROS 2 robot", "simulator/hardware/config.py", RobotHardwareSettings),
    Section("Simulated RTSP cameras", "simulator/hardware/config.py", CameraHardwareSettings),
    Section("Camera", "services/camera_node/config.py", CameraSettings),
    Section("Robot", "services/robot_node/config.py", RobotSettings),
    Section("Perception", "services/perception/config.py", PerceptionSettings),
    Section("Fusion", "services/fusion/config.py", FusionSettings, FusionConfig),
    Section("Planner", "services/planner/config.py", PlannerSettings),
    Section("Gateway", "services/gateway/config.py", GatewaySettings),
    Section("Recorder", "services/recorder/config.py", RecorderSettings),
    Section("The benchmark's policy llm", "benchmark/policies/language_model.py", LanguageModelSettings),
)


@dataclass(frozen=True, slots=True)
class Setting:
    """A row of a page: the variable, its default as it would be written, and what it decides."""

    variable: str
    default: str
    choices: tuple[str, ...]
    description: str

    @property
    def common(self) -> bool:
        """Whether people need it; else it is an expert's."""
        return self.variable in COMMON


def settings_of(section: Section) -> Iterator[tuple[str, list[Setting]]]:
    """Tables of settings by heading: the service's own first, then one for each part of its core."""
    prefix = str(section.settings.model_config["env_prefix"])
    fields = dict(section.settings.model_fields)
    parts: dict[str, FieldInfo] = dict(section.config.model_fields) if section.config else {}
    parts |= {name: field for name, field in fields.items() if _is_part(field)}
    own = [_setting(prefix, name, field) for name, field in fields.items() if name not in parts]
    yield section.title, own
    for name, field in parts.items():
        yield from _tables(f"{section.title}: {name}", f"{prefix}{name.upper()}__", _part(field))


def _tables(title: str, prefix: str, part: type[BaseModel]) -> Iterator[tuple[str, list[Setting]]]:
    """The tables of a part and of the parts in it, the outer first."""
    own = {name: field for name, field in part.model_fields.items() if not _is_part(field)}
    if own:
        yield title, [_setting(prefix, name, field) for name, field in own.items()]
    for name, field in part.model_fields.items():
        if name not in own:
            yield from _tables(f"{title}, {name}", f"{prefix}{name.upper()}__", _part(field))


def _is_part(field: FieldInfo) -> bool:
    return isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)


def _part(field: FieldInfo) -> type[BaseModel]:
    assert isinstance(field.annotation, type)
    assert issubclass(field.annotation, BaseModel)
    return field.annotation


def _setting(prefix: str, name: str, field: FieldInfo) -> Setting:
    return Setting(
        prefix + name.upper(),
        _written(field.get_default(call_default_factory=True)),
        tuple(_choices(field)),
        field.description or "",
    )


def _choices(field: FieldInfo) -> Iterator[str]:
    """The words that a setting may be; none where it is free."""
    if typing.get_origin(field.annotation) is typing.Literal:
        yield from map(str, typing.get_args(field.annotation))
        return
    for rule in field.metadata:
        words = re.fullmatch(r"\^?\(?([a-z-]+(?:\|[a-z-]+)+)\)?\$?", str(getattr(rule, "pattern", None) or ""))
        if words:
            yield from words[1].split("|")


def _written(value: Any) -> str:
    """A default as it would stand in the environment."""
    match value:
        case bool():
            return str(value).lower()
        case float() if math.isfinite(value):
            return f"{value:.6g}"
        case None | "" | [] | {}:
            return "not set"
        case Mapping():
            return "; ".join(f"{k} {_written(v)}" for k, v in value.items())
        case list() | tuple():
            return ", ".join(map(_written, value))
        case _:
            return str(value)


def pages() -> dict[str, str]:
    """The text of the pages by their names."""
    return {
        "settings.md": "\n".join([_BEGINNING, *_sections(common=True)]),
        "settings-expert.md": "\n".join([_EXPERT_BEGINNING, *_sections(common=False)]),
    }


def _sections(*, common: bool) -> Iterator[str]:
    for section in SECTIONS:
        for title, settings in settings_of(section):
            if not (rows := [_row(setting) for setting in settings if setting.common == common]):
                continue
            yield from (f"## {title}", "")
            if title == section.title:
                yield from (f"[`{section.module}`](../../{section.module})", "")
            yield from ("| variable | default | what |", "|---|---|---|", *rows, "")


def _row(setting: Setting) -> str:
    what = setting.description
    if setting.choices:
        words = "one of " + ", ".join(f"`{c}`" for c in setting.choices)
        what = f"{what} ({words})" if what else words
    cells = f"`{setting.variable}`", setting.default, what
    return "| " + " | ".join(cell.replace("|", "\\|").replace("<", "&lt;") for cell in cells) + " |"


if __name__ == "__main__":
    for name, text in pages().items():
        (Path(sys.argv[1]) / name).write_text(text, encoding="utf-8")
