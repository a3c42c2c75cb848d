"""Certificates (X.509): a building's own authority, what it issues, and what is wrong with a certificate or a key.

Keys are of the curve P-256. A certificate's common name is its identity. Only a router's certificate is good for a server; it
also names the hosts by which clients reach it.
"""

from __future__ import annotations

import ipaddress
import stat
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from surveilnav.errors import ConfigError

#: A clock may be late by this much and still find a new certificate valid.
_BACKDATED = timedelta(hours=1)


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A certificate and its private key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def certificate_pem(self) -> bytes:
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        return self.key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )


def make_authority(building: str, now: datetime, valid: timedelta) -> KeyPair:
    """A new authority for a building, which signs itself."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"SurveilNav {building}"[:64])
    certificate = (
        _unsigned(name, name, key.public_key(), now, valid)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return KeyPair(certificate, key)


def issue(
    authority: KeyPair, common_name: str, now: datetime, valid: timedelta, reached_as: tuple[str, ...] = ()
) -> KeyPair:
    """A new key with a certificate.

    Args:
        reached_as: host names and addresses by which clients connect to it: a router's.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH] + ([ExtendedKeyUsageOID.SERVER_AUTH] if reached_as else [])
    builder = (
        _unsigned(_name(common_name), authority.certificate.subject, key.public_key(), now, valid)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.certificate.public_key()),  # type: ignore[arg-type]
            critical=False,
        )
    )
    if names := [_alternative_name(host) for host in dict.fromkeys(reached_as)]:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return KeyPair(builder.sign(authority.key, hashes.SHA256()), key)


def _unsigned(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: datetime, valid: timedelta
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _BACKDATED)
        .not_valid_after(now + valid)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _alternative_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host.strip("[]")))
    except ValueError:
        return x509.DNSName(host)


# --- reading and checking -----------------------------------------------------------------------------------------


def read_certificate(path: Path) -> x509.Certificate:
    """The certificate in a PEM file.

    Raises:
        ConfigError: it can't be read, or has none.
    """
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"the certificate {path} can't be read: {error.strerror}") from None
    except ValueError:
        raise ConfigError(f"expected a certificate in PEM format in {path}; it has none that can be read") from None


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """The private key in a PEM file. No error tells anything of its content.

    Raises:
        ConfigError: it can't be read, others than its owner may read it, or it is no key.
    """
    if fault := fault_of_rights(path):
        raise ConfigError(fault)
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except OSError as error:
        raise ConfigError(f"the key {path} can't be read: {error.strerror}") from None
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise ConfigError(
            f"expected a private key without a password, in PEM format, in {path}; it has none that can be read"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"expected an elliptic curve's private key in {path}; it has another kind")
    return key


def fault_of_rights(path: Path) -> str | None:
    """What is wrong with the rights of a file with a secret: others may read it, or its group may write it; None: nothing."""
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
    except OSError as error:
        return f"the key {path} can't be read: {error.strerror}"
    if mode & (stat.S_IRWXO | stat.S_IWGRP):
        return f"the key {path} is open to others (mode {mode:04o}): chmod 600 {path}"
    return None


def common_name(certificate: x509.Certificate) -> str:
    """A certificate's common name; empty if it has none."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def fault_of_time(certificate: x509.Certificate, now: datetime) -> str | None:
    """Why a certificate isn't valid at a time (with time zone); None: it is."""
    if now < certificate.not_valid_before_utc:
        return f"is valid only from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on; is this machine's clock right?"
    if now > certificate.not_valid_after_utc:
        return f"expired at {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC"
    return None


def is_issued_by(certificate: x509.Certificate, authority: x509.Certificate) -> bool:
    """Whether an authority has signed a certificate."""
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def belongs_to(key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> bool:
    """Whether a private key is the one of a certificate."""
    form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    return key.public_key().public_bytes(*form) == certificate.public_key().public_bytes(*form)
