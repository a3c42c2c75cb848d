"""What every service of compose.yaml must have, checked without an engine."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
import yaml

from surveilnav.cli.security import DEFAULT_KEYS
from surveilnav.pictures import PictureSettings
from surveilnav.security.identities import identity_from_name
from surveilnav.services.perception.config import PerceptionSettings

_ROOT = Path(__file__).parents[2]
_COMPOSE = yaml.safe_load((_ROOT / "compose.yaml").read_text(encoding="utf-8"))
_SERVICES = _COMPOSE["services"]
_ONE_SHOT = {"prepare"}
_ON_A_GPU = {"perception-gpu"}
#: Prometheus and Grafana, whose images aren't ours.
_OBSERVERS = {"prometheus", "grafana"}
_DOCKERFILE = (_ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_it_starts_the_whole_system() -> None:
    started = {name for name, service in _SERVICES.items() if not service.get("profiles")}
    assert started == {"router", "prepare", "camera", "robot", "perception", "fusion", "planner", "gateway", "recorder"}
    profiles = {name: service["profiles"] for name, service in _SERVICES.items() if name not in started}
    assert profiles == {name: ["gpu"] if name in _ON_A_GPU else ["obs"] for name in _ON_A_GPU | _OBSERVERS}
    assert "version" not in _COMPOSE


@pytest.mark.parametrize("name", _SERVICES)
def test_every_service_is_confined(name: str) -> None:
    service = _SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert service["mem_limit"]
    assert service["init"] is True, "without an init a service that is still starting ignores SIGTERM"
    assert "container_name" not in service, "a service with a fixed name can't be scaled"
    assert not service.get("privileged")


@pytest.mark.parametrize("name", sorted(set(_SERVICES) - _ONE_SHOT))
def test_every_lasting_service_is_watched_and_restarted(name: str) -> None:
    service = _SERVICES[name]
    assert service["healthcheck"]["test"]
    assert not service["healthcheck"].get("disable")
    assert service["restart"] == "unless-stopped"


@pytest.mark.parametrize("name", sorted(set(_SERVICES) - _ONE_SHOT - _OBSERVERS - {"router"}))
def test_every_node_waits_for_the_router_and_has_a_heartbeat(name: str) -> None:
    service = _SERVICES[name]
    assert service["depends_on"]["router"] == {"condition": "service_healthy"}
    heartbeat = service["environment"]["SURVEILNAV_BUS__HEALTH_FILE"]
    assert heartbeat in service["healthcheck"]["test"][-1]


@pytest.mark.parametrize("name", ["camera", "robot"])
def test_the_simulators_wait_for_the_building_and_share_its_cache(name: str) -> None:
    assert _SERVICES[name]["depends_on"]["prepare"] == {"condition": "service_completed_successfully"}
    assert set(_SERVICES["prepare"]["volumes"]) <= set(_SERVICES[name]["volumes"])
    settings = _SERVICES["prepare"]["environment"]
    assert {k: _SERVICES[name]["environment"][k] for k in settings} == settings


def test_only_the_simulators_know_which_building_it_is() -> None:
    told = {n for n, s in _SERVICES.items() if any("SIM__" in key for key in s.get("environment", {}))}
    assert told == {"prepare", "camera", "robot"}


@pytest.mark.parametrize("name", _SERVICES)
def test_ports_are_bound_to_this_machine_only(name: str) -> None:
    ports = _SERVICES[name].get("ports", [])
    assert all(port.startswith("127.0.0.1:") for port in ports)
    assert bool(ports) == (name in ("gateway", "grafana"))


#: Which image a service runs that isn't the one of most.
_IMAGES = dict.fromkeys(("prepare", "camera", "robot", "perception"), "surveilnav-simulation") | {
    "perception-gpu": "surveilnav-gpu"
}
_STAGES = [line.split()[-1] for line in _DOCKERFILE.splitlines() if line.startswith("FROM") and " AS " in line]


def test_each_service_runs_the_image_of_its_need_which_one_service_builds() -> None:
    ours = {name: service["image"] for name, service in _SERVICES.items() if name not in _OBSERVERS}
    assert ours == dict.fromkeys(ours, "surveilnav") | _IMAGES
    builds = {name: service["build"] for name, service in _SERVICES.items() if "build" in service}
    targets = {name: build["target"] for name, build in builds.items()}
    assert targets == {"router": "services", "prepare": "simulation", "perception-gpu": "gpu"}
    assert set(targets.values()) <= set(_STAGES)
    last = [line for line in _DOCKERFILE.splitlines() if line.startswith("FROM")][-1]
    assert last == "FROM services", "the image of most comes last: it is what `docker build` makes"


def test_a_building_s_own_cameras_need_no_simulator() -> None:
    services = yaml.load((_ROOT / "compose.cameras.yaml").read_text(encoding="utf-8"), _Loader)["services"]
    images = {name: s.get("image", _SERVICES[name]["image"]) for name, s in services.items()}
    assert {images.pop(name) for name in _OBSERVERS} == {_SERVICES[name]["image"] for name in _OBSERVERS}
    assert images == dict.fromkeys(images, "surveilnav")


class _Loader(yaml.SafeLoader):
    """Reads compose's own tags, such as !override, as if they weren't there."""


_Loader.add_multi_constructor(
    "!",
    lambda loader, tag, node: (
        loader.construct_mapping(node)
        if isinstance(node, yaml.MappingNode)
        else loader.construct_sequence(node)
        if isinstance(node, yaml.SequenceNode)
        else None
    ),
)


def test_the_base_image_can_be_named_by_its_digest() -> None:
    bases = [line.split()[1] for line in _DOCKERFILE.splitlines() if line.startswith("FROM")]
    assert {base for base in bases if base not in _STAGES} == {"${BASE}"}
    for service in _SERVICES.values():
        if "build" in service:
            assert service["build"]["args"] == {"BASE": "${SURVEILNAV_BASE:-python:3.11-slim-bookworm}"}


def test_whatever_an_image_installs_is_checked_by_its_hash() -> None:
    installs = re.findall(r"pip install ((?:.*\\\n)*.*)", _DOCKERFILE)
    assert len(installs) == 5
    own = [line for line in installs if "--require-hashes" not in line]
    assert [("--no-deps" in line, "--no-build-isolation" in line, line.endswith(" .")) for line in own] == [(True,) * 3]


def test_simulators_share_no_cache_with_images_that_have_no_furniture() -> None:
    """Docker fills an empty volume from the image of the container that is there first."""
    by_volume: dict[str, set[str]] = {}
    for service in _SERVICES.values():
        for volume in service.get("volumes", []):
            if volume.endswith(":/var/cache/surveilnav"):
                by_volume.setdefault(volume.split(":")[0], set()).add(service["image"])
    assert by_volume == {"cache": {"surveilnav-simulation"}, "compiled": {"surveilnav", "surveilnav-gpu"}}


def test_the_gpu_worker_has_an_image_and_a_name_of_its_own_and_starts_only_if_asked_for() -> None:
    gpu, perception = _SERVICES["perception-gpu"], _SERVICES["perception"]
    assert gpu["profiles"] == ["gpu"]
    assert gpu["environment"]["SURVEILNAV_PERCEPTION__WORKER"] != PerceptionSettings.model_fields["worker"].default
    assert perception["command"][-1].endswith(" ".join(gpu["command"]))
    assert gpu["deploy"]["resources"]["reservations"]["devices"][0]["capabilities"] == ["gpu"]


_TOLD = ("DETECTOR", "SEGMENTER", "EMBEDDER", "THRESHOLD", "WORDS_PER_PASS", "THREADS", "COMPILED", "MAX_BATCH")


@pytest.mark.parametrize("setting", _TOLD)
def test_the_gpu_worker_can_be_told_what_it_runs(setting: str) -> None:
    given = _SERVICES["perception-gpu"]["environment"][f"SURVEILNAV_PERCEPTION__{setting}"]
    assert given.startswith(f"${{SURVEILNAV_PERCEPTION_GPU__{setting}:-")
    assert setting.lower() in PerceptionSettings.model_fields


def test_what_the_gpu_worker_is_not_told_is_as_the_service_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("SURVEILNAV_PERCEPTION__")]:
        monkeypatch.delenv(name)
    bare = PerceptionSettings()
    for name, given in _SERVICES["perception-gpu"]["environment"].items():
        if name.startswith("SURVEILNAV_PERCEPTION__") and given.endswith(":-}"):
            monkeypatch.setenv(name, "")
    assert PerceptionSettings() == bare


def test_the_gpu_worker_may_take_longer_to_load_than_others() -> None:
    period = {name: _SERVICES[name]["healthcheck"]["start_period"] for name in ("perception", "perception-gpu")}
    assert period == {"perception": "120s", "perception-gpu": "30m"}


@pytest.mark.parametrize("name", ["fusion", "planner", "robot"])
def test_what_must_outlive_a_container_lies_in_a_volume_by_building(name: str) -> None:
    service = _SERVICES[name]
    store = service["environment"][f"SURVEILNAV_{name.upper()}__STORE"]
    volume, mount = next(v for v in service["volumes"] if v.startswith("state:")).split(":")
    assert volume in _COMPOSE["volumes"]
    assert store.startswith(f"{mount}/")
    assert "${SURVEILNAV_SIM__BUILDING:-" in store, "another building's maps and missions would be taken up"
    created = re.search(r"install -d -o 10001 -g 10001 (.*) ", _DOCKERFILE)
    assert created
    assert mount in created[1].split()


def test_whoever_keeps_past_pictures_is_told_for_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "SURVEILNAV_PICTURES__KEEP_H"
    told = {n: s["environment"][name] for n, s in _SERVICES.items() if name in s.get("environment", {})}
    assert told == dict.fromkeys(["fusion", "recorder"], f"${{{name}:-}}")
    monkeypatch.setenv(name, "")
    assert PictureSettings().keep_h is None, "who sets nothing hands on an empty text"


def test_cameras_look_with_the_backend_of_perception_unless_told_otherwise() -> None:
    camera, perception = _SERVICES["camera"], _SERVICES["perception"]
    backend = perception["environment"]["SURVEILNAV_PERCEPTION__BACKEND"]
    assert camera["environment"]["SURVEILNAV_CAMERA__PERCEPTION"] == "${SURVEILNAV_CAMERA__PERCEPTION:-" + backend + "}"
    of_models = {volume for volume in perception["volumes"] if not volume.startswith("handover:")}
    assert of_models <= set(camera["volumes"])


def test_who_handles_many_pictures_hands_them_over_in_memory() -> None:
    """And nobody else sees the folder: what lies there is under no rule of the router."""
    sharing = {name for name, service in _SERVICES.items() if "handover:/run/handover" in service.get("volumes", ())}
    assert sharing == {"perception", "perception-gpu", "fusion", "recorder"}
    for name in sharing:
        assert _SERVICES[name]["environment"]["SURVEILNAV_BUS__HANDOVER_FOLDER"] == "/run/handover"


# --- compose.secure.yaml ------------------------------------------------------------------------------------------

_SECURE = yaml.safe_load((_ROOT / "compose.secure.yaml").read_text(encoding="utf-8"))


def test_every_node_has_an_identity_of_its_own() -> None:
    nodes = {name: service for name, service in _SECURE["services"].items() if name not in _OBSERVERS}
    assert set(nodes) == set(_SERVICES) - _ONE_SHOT - _OBSERVERS
    keys = {}
    for name, service in nodes.items():
        given = {secret["target"]: secret["source"] for secret in service["secrets"]}
        environment = service["environment"]
        assert environment["SURVEILNAV_BUS__ROUTER"] == "tls/router:7447"
        for variable, file in (("CA", "ca.pem"), ("CERTIFICATE", "certificate.pem"), ("KEY", "key.pem")):
            assert environment[f"SURVEILNAV_BUS__TLS_{variable}"] == f"/run/secrets/{file}"
            assert file in given
        identity = given["key.pem"].removesuffix("-key")
        assert given["certificate.pem"] == f"{identity}-certificate"
        assert _SECURE["secrets"][given["key.pem"]]["file"].endswith(f"/identities/{identity}/key.pem")
        identity_from_name(identity)
        keys[name] = identity
    assert keys.pop("perception-gpu") == keys["perception"], "the one runs in place of the other"
    assert len(set(keys.values())) == len(keys)
    assert not any("ca.key" in secret["file"] for secret in _SECURE["secrets"].values())


def test_the_secure_gateway_needs_keys_and_sees_a_change_of_their_file() -> None:
    gateway = _SECURE["services"]["gateway"]
    assert gateway["environment"]["SURVEILNAV_GATEWAY__AUTHENTICATION"] == "keys"
    file = Path(gateway["environment"]["SURVEILNAV_GATEWAY__KEYS_FILE"])
    assert gateway["volumes"] == [f"${{SURVEILNAV_SECURITY_DIR:-./security}}/gateway:{file.parent}:ro"], "a folder"
    assert Path("security/gateway") / file.name == DEFAULT_KEYS
    assert not any(service.get("ports") for service in _SECURE["services"].values())


def test_without_security_the_gateway_answers_everybody_on_this_machine_alone() -> None:
    gateway = _SERVICES["gateway"]
    assert gateway["environment"]["SURVEILNAV_GATEWAY__AUTHENTICATION"] == "${SURVEILNAV_GATEWAY__AUTHENTICATION:-none}"
    assert all(port.startswith("127.0.0.1:") for port in gateway["ports"])


def test_prometheus_asks_a_secure_gateway_with_a_key() -> None:
    plain, secure = _SERVICES["prometheus"], _SECURE["services"]["prometheus"]
    assert secure["profiles"] == plain["profiles"], "otherwise its secret would be needed without it, too"
    assert secure["command"] == [word.replace("prometheus.yml", "prometheus.secure.yml") for word in plain["command"]]
    (secret,) = secure["secrets"]
    file = yaml.safe_load((_ROOT / "docs/operate/prometheus/prometheus.secure.yml").read_text(encoding="utf-8"))
    assert file["scrape_configs"][0]["authorization"]["credentials_file"] == f"/run/secrets/{secret['target']}"


def test_security_of_own_cameras_is_that_of_the_services_that_they_have() -> None:
    read = [
        yaml.load((_ROOT / f"compose.cameras{part}.yaml").read_text(encoding="utf-8"), _Loader)["services"]
        for part in ("", ".secure")
    ]
    assert set(read[1]) == set(_SECURE["services"]) - set(read[0])
    assert not any(read[1].values()), "they only go"
