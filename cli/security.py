"""``surveilnav security ...``: certificates and access rules for the bus, and API keys for the gateway."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import AsJson, console, items, print_result, results
from surveilnav.security.roles import Role

app = typer.Typer(help="Identities for the bus, and keys for the gateway.", no_args_is_help=True)
key_app = typer.Typer(help="API keys of the gateway.", no_args_is_help=True)
app.add_typer(key_app, name="key")

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder with the authority and the identities.")]
Name = Annotated[str, typer.Argument(metavar="NAME", help="fusion, camera-lobby, robot-r1, viewer-anna, ...")]
KeysFile = Annotated[
    Path,
    typer.Option(
        envvar="SURVEILNAV_GATEWAY__KEYS_FILE", metavar="FILE", help="The file of keys that the gateway reads."
    ),
]
DEFAULT_KEYS = Path("security/gateway/api_keys.json")
#: What each building has of services.
_SERVICES = ("router", "fusion", "planner", "gateway", "recorder", "perception", "supervisor")


@app.command()
@needs("services")
def init(
    folder: Folder,
    building: Annotated[
        str, typer.Option(metavar="NAME", help="The building's name on the bus, as in SURVEILNAV_BUS__BUILDING.")
    ] = "building",
    cameras: Annotated[
        str,
        typer.Option(metavar="NAMES", help="Cameras, separated by commas, and a number for spare ones: lobby,gate,4."),
    ] = "4",
    robots: Annotated[str, typer.Option(metavar="NAMES", help="Robots, in the same way.")] = "r1,1",
    viewers: Annotated[
        str, typer.Option(metavar="NAMES", help="Programs that read the bus's state, but no pictures, in the same way.")
    ] = "",
    router_names: Annotated[
        str, typer.Option("--router-names", metavar="HOSTS", help="Hosts by which the router is reached.")
    ] = "localhost,127.0.0.1,::1,router",
    shared_cameras: Annotated[
        bool,
        typer.Option(
            "--shared-cameras", help="Also one identity for all replicas of a container, each of which is a camera."
        ),
    ] = False,
    simulation: Annotated[bool, typer.Option("--simulation", help="Allow the simulator's truth channel.")] = False,
    as_json: AsJson = False,
) -> None:
    """Make an authority, an identity for each process, and the router's access rules. Overwrites nothing."""
    from surveilnav.security.folder import SecurityFolder
    from surveilnav.security.identities import identity_from_name

    names = [*_SERVICES, *(["cameras"] if shared_cameras else [])]
    for kind, listed in (("camera", cameras), ("robot", robots), ("viewer", viewers)):
        names += [f"{kind}-{name}" for name in _names(listed)]
    hosts = tuple(_words(router_names))
    made = SecurityFolder.create(
        folder, building, [identity_from_name(name) for name in names], hosts, simulation=simulation
    )
    said = {"folder": str(folder), "building": building, "identities": made.names()}
    print_result(said, as_json, lambda: _show_new(folder, made.names()))


@app.command()
@needs("services")
def check(folder: Folder, as_json: AsJson = False) -> None:
    """Name what is wrong: expired or early certificates, open rights, keys of other certificates, names used twice."""
    from surveilnav.security.folder import SecurityFolder

    made = SecurityFolder(folder)
    faults, warnings = made.faults(), made.warnings()
    print_result({"faults": faults, "warnings": warnings}, as_json, lambda: _show_faults(faults, warnings))
    raise typer.Exit(1 if faults else 0)


@app.command()
@needs("services")
def issue(folder: Folder, name: Name, as_json: AsJson = False) -> None:
    """Issue one more identity, and add it to the router's rules, which it reads when it starts."""
    from surveilnav.security.folder import SecurityFolder
    from surveilnav.security.identities import identity_from_name

    path = SecurityFolder(folder).issue(identity_from_name(name))
    text = f"{path}: hand it to {name}, and restart the router, which then knows it"
    print_result(
        {"name": name, "folder": str(path)}, as_json, lambda: results.print(text, markup=False, soft_wrap=True)
    )


@app.command()
@needs("services")
def renew(
    folder: Folder,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAMES]...", help="Which; all if none is named.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Give identities new keys and certificates. The old ones are good until they expire."""
    from surveilnav.security.folder import SecurityFolder

    made = SecurityFolder(folder)
    paths = {name: str(made.renew(name)) for name in names or made.names()}
    text = "\n".join(f"{path}: restart {name}" for name, path in paths.items())
    print_result(items(list(paths)), as_json, lambda: results.print(text, markup=False, soft_wrap=True))


@app.command()
@needs("services")
def remove(folder: Folder, name: Name, as_json: AsJson = False) -> None:
    """Remove an identity from the router's rules: once the router has restarted, its owner may do nothing."""
    from surveilnav.security.folder import SecurityFolder

    SecurityFolder(folder).remove(name)
    text = f"{name} is removed. Restart the router: until then it lets {name} do what it did."
    print_result({"name": name}, as_json, lambda: results.print(text, markup=False, soft_wrap=True))


@app.command()
@needs("services")
def rules(folder: Folder, as_json: AsJson = False) -> None:
    """Write the router's rules anew, after an upgrade of SurveilNav or a change by hand."""
    from surveilnav.security.folder import ACCESS, SecurityFolder

    SecurityFolder(folder).write_rules()
    path = folder / ACCESS
    text = f"{path}: restart the router"
    print_result({"file": str(path)}, as_json, lambda: results.print(text, markup=False, soft_wrap=True))


# --- keys ---------------------------------------------------------------------------------------------------------


def _role(text: str) -> Role:
    if text not in Role.__members__:
        raise typer.BadParameter(f"expected {', '.join(role.name for role in Role)}, got {text!r}")
    return Role[text]


KeyName = Annotated[str, typer.Argument(metavar="NAME", help="Whose key it is: a person or a program.")]


@key_app.command("add")
@needs("services")
def add_key(
    name: KeyName,
    role: Annotated[
        str,
        typer.Option(
            metavar="ROLE", help="viewer reads, operator also commands missions and robots, admin does everything."
        ),
    ],
    file: KeysFile = DEFAULT_KEYS,
    as_json: AsJson = False,
) -> None:
    """Make a key and show it once. A running gateway knows it at once."""
    from surveilnav.security.api_keys import ApiKeysFile

    chosen = _role(role)
    _show_key(name, ApiKeysFile(file).add(name, chosen), as_json)


@key_app.command("list")
@needs("services")
def list_keys(file: KeysFile = DEFAULT_KEYS, as_json: AsJson = False) -> None:
    """List the names, roles and dates of all keys."""
    from surveilnav.security.api_keys import ApiKeysFile

    rows = [{"name": k.name, "role": k.role.name, "id": k.id, "created": k.created} for k in ApiKeysFile(file).read()]
    text = "\n".join(f"{r['name']}  {r['role']}  {r['id']}  {r['created']}" for r in rows) or "there are no keys"
    print_result(items(rows), as_json, lambda: results.print(text, markup=False, soft_wrap=True))


@key_app.command("rotate")
@needs("services")
def rotate_key(name: KeyName, file: KeysFile = DEFAULT_KEYS, as_json: AsJson = False) -> None:
    """Replace a key and show the new one once. The old one is void at once."""
    from surveilnav.security.api_keys import ApiKeysFile

    _show_key(name, ApiKeysFile(file).rotate(name), as_json)


@key_app.command("revoke")
@needs("services")
def revoke_key(name: KeyName, file: KeysFile = DEFAULT_KEYS, as_json: AsJson = False) -> None:
    """Make a key void, with the sessions that it opened, at once."""
    from surveilnav.security.api_keys import ApiKeysFile

    ApiKeysFile(file).revoke(name)
    print_result({"name": name}, as_json, lambda: results.print(f"the key {name} is void", markup=False))


def _show_key(name: str, key: str, as_json: bool) -> None:
    """The key goes to standard output, alone, so that a script can store it."""
    if not as_json:
        console.print(f"the key of {name}; it isn't shown again:", markup=False)
    print_result({"name": name, "key": key}, as_json, lambda: print(key))


# --- words --------------------------------------------------------------------------------------------------------


def _words(listed: str) -> list[str]:
    return [word.strip() for word in listed.split(",") if word.strip()]


def _names(listed: str) -> list[str]:
    """The names in a list with commas. A number stands for so many spare ones."""
    found = []
    for word in _words(listed):
        found += [f"spare-{i + 1}" for i in range(int(word))] if word.isdecimal() else [word]
    return found


def _show_new(folder: Path, names: list[str]) -> None:
    results.print(
        f"{len(names)} identities in {folder / 'identities'}: {', '.join(names)}", markup=False, soft_wrap=True
    )
    console.print(
        f"{folder / 'ca.key'} can make any identity: keep it where no process of the building runs. Hand each process its "
        "own folder of identities/ and nothing else; the router also gets access.json.",
        markup=False,
    )


def _show_faults(faults: list[str], warnings: list[str]) -> None:
    for fault in faults:
        results.print(f"fault: {fault}", markup=False, soft_wrap=True)
    for warning in warnings:
        results.print(f"soon: {warning}", markup=False, soft_wrap=True)
    if not faults:
        results.print("everything is in order", markup=False)
