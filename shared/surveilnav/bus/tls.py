"""The identity of a process on an encrypted bus: its files, what is wrong with them, and why a router wouldn't have it."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from surveilnav.errors import BusError, ConfigError

#: Time limit for the attempt that is to explain a failure.
_EXPLAIN_S = 3.0
_REFUSAL_S = 0.5


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """The authority's certificate, and this process's own certificate and key."""

    ca: Path
    certificate: Path
    key: Path

    def zenoh_config(self) -> dict[str, object]:
        """Zenoh's ``transport.link.tls``, for a client and a router. Links end when a certificate expires."""
        certificate, key = str(self.certificate.absolute()), str(self.key.absolute())
        return {
            "root_ca_certificate": str(self.ca.absolute()),
            "listen_certificate": certificate,
            "listen_private_key": key,
            "connect_certificate": certificate,
            "connect_private_key": key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }

    def check(self) -> str:
        """Checks the files, and returns the common name of the certificate.

        Raises:
            ConfigError: a file can't be read, the key is open to others or doesn't belong to the certificate, or a certificate
                has expired, isn't valid yet, or is another authority's. The message has nothing of the key in it.
        """
        from surveilnav.security import certificates  # a bus without security needs no cryptography

        authority, own = certificates.read_certificate(self.ca), certificates.read_certificate(self.certificate)
        key = certificates.read_key(self.key)
        now = datetime.now(UTC)
        for path, certificate in ((self.ca, authority), (self.certificate, own)):
            if fault := certificates.fault_of_time(certificate, now):
                raise ConfigError(f"the certificate {path} {fault}. `surveilnav security renew` issues a new one.")
        if not certificates.is_issued_by(own, authority):
            raise ConfigError(f"the certificate {self.certificate} isn't issued by the authority in {self.ca}")
        if not certificates.belongs_to(key, own):
            raise ConfigError(f"the key {self.key} doesn't belong to the certificate {self.certificate}")
        return certificates.common_name(own)

    def explain(self, host: str, port: int) -> str:
        """Why no connection to a router comes about, found by one attempt: "" if nothing is there, or all is well."""
        try:
            connection = socket.create_connection((host, port), _EXPLAIN_S)
        except OSError:
            return ""
        context = ssl.create_default_context(cafile=str(self.ca))
        context.load_cert_chain(self.certificate, self.key)
        with connection:
            try:
                encrypted = context.wrap_socket(connection, server_hostname=host)
            except ssl.SSLCertVerificationError as error:
                return f"its certificate isn't right for {host}: {error.verify_message}"
            except OSError:
                return "it doesn't answer as TLS does: it was started without an identity, or is no router"
            with encrypted:
                return _refusal(encrypted)


def _refusal(encrypted: ssl.SSLSocket) -> str:
    """Why a server ends a connection after the handshake: in TLS 1.3 it refuses a client's certificate only then."""
    encrypted.settimeout(_REFUSAL_S)
    try:
        encrypted.recv(1)
    except ssl.SSLError as error:
        return f"it refuses this process's certificate: {(error.reason or str(error)).lower().replace('_', ' ')}"
    except OSError:
        pass
    return ""


def check_owner(name: str, kind: str, id: str) -> None:
    """Checks that a certificate's common name is the one of a node.

    Without that, the router would drop what the node sends, and nobody would say why.

    Raises:
        BusError: it is for somebody else.
    """
    if name in (kind, f"{kind}-{id}") or (kind == "camera" and name == "cameras"):
        return
    raise BusError(
        f"this process is the {kind} {id!r}, but its certificate is for {name!r}: give it the files of {kind}"
        f"{'' if kind not in ('camera', 'robot') else f'-{id}'} (SURVEILNAV_BUS__TLS_CERTIFICATE and _KEY)"
    )
