"""``passwords.env`` beside ``cameras.yaml``: the passwords of streams, so that they needn't stand in the file of cameras.

It has a line ``NAME=value`` for each, as Docker Compose reads it. A value is written as in an address, with ``%40`` for ``@``.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

FILE_NAME = "passwords.env"
_MAX_BYTES = 1 << 20
_ADDRESS = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*://)(?P<authority>[^/?#]*)(?P<rest>.*)", re.DOTALL)
#: Parameters of an address in which cameras take a password.
_IN_QUERY = re.compile(r"(?<=[?&])(password|passwd|pass|pwd|token|secret|key|auth)=([^&#]+)", re.IGNORECASE)
_VARIABLE = re.compile(r"\$\{[A-Za-z_][A-Za-z0-9_]*\}")


def passwords_in(folder: Path) -> dict[str, str]:
    """The variables of the ``passwords.env`` of a folder; {} if there is none that this process may read.

    In a container they are in the environment already, and only the owner of the file may read it.
    """
    try:
        with (folder / FILE_NAME).open(encoding="utf-8") as file:
            lines = file.read(_MAX_BYTES).splitlines()
    except (OSError, UnicodeDecodeError):
        return {}
    pairs = (line.split("=", 1) for line in lines if "=" in line and not line.lstrip().startswith("#"))
    return {name.strip().removeprefix("export "): _unquoted(value.strip()) for name, value in pairs}


def _unquoted(value: str) -> str:
    return value[1:-1] if len(value) > 1 and value[0] == value[-1] and value[0] in "'\"" else value


def without_secrets(address: str, camera: str, user: str = "", password: str = "") -> tuple[str, dict[str, str]]:
    """An address for ``cameras.yaml``, with ``${NAME}`` in place of each password, and the values of these variables.

    Args:
        camera: its name, which names the variables.
        user, password: those that the address doesn't name, as a person types them.

    Raises:
        ValueError: the address has no host, or a user and a password twice. The message has nothing of the address.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None:
        if user or password:
            raise ValueError("only an address such as rtsp://10.0.0.5/stream1 takes a user and a password")
        return address, {}
    named, at, host = match["authority"].rpartition("@")
    if not _is_host(host) or (not at and "@" in match["rest"].partition("?")[0]):
        raise ValueError(
            "expected an address such as rtsp://10.0.0.5/stream1; a password with / ? # or @ in it is given on its own"
        )
    if named and (user or password) and ":" in named:
        raise ValueError("the address has a user and a password already: leave out the others")
    typed_user, _, typed_password = named.partition(":")
    secrets: dict[str, str] = {}
    user, password = quote(user, safe="") or typed_user, quote(password, safe="") or typed_password
    if password:
        user += ":" + _variable(secrets, f"{camera}_PASSWORD", password)
    rest = _IN_QUERY.sub(lambda m: f"{m[1]}={_variable(secrets, f'{camera}_QUERY_{m[1]}', m[2])}", match["rest"])
    return f"{match['scheme']}{f'{user}@' if user else ''}{host}{rest}", secrets


def _is_host(host: str) -> bool:
    """Whether it is a name or address, with or without a port."""
    try:
        parts = urlsplit(f"//{host}")
        return bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False


def _variable(secrets: dict[str, str], name: str, value: str) -> str:
    if _VARIABLE.fullmatch(value):
        return value
    name = re.sub(r"\W", "_", name, flags=re.ASCII).upper()
    name = f"CAMERA_{name}" if name[0].isdigit() else name
    secrets[name] = quote(unquote(value), safe="")
    return f"${{{name}}}"
