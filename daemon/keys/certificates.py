"""The authority and the certificates that it signs: X.509, ECDSA on P-256 (RFC 5280)."""

import datetime
import ipaddress
from collections.abc import Sequence
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from gaitd_toml import COMMAND_LINE, ConfigError

AUTHORITY_DAYS: Final = 3650
EARLIER: Final = datetime.timedelta(days=1)
"""Certificates are valid from a day before, for clocks that are late."""


class Pair(NamedTuple):
    """A certificate and its private key, both as PEM."""

    certificate: bytes
    key: bytes


def new_authority(trainer: str, now: datetime.datetime) -> Pair:
    """A new authority for one trainer; `now` in UTC."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"gaitd {trainer}")
    builder = _builder(name, name, key.public_key(), key.public_key(), now, AUTHORITY_DAYS)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(_usage(signs_certificates=True), critical=True)
    return _pair(builder.sign(key, hashes.SHA256()), key)


def new_certificate(
    authority: Pair,
    name: str,
    now: datetime.datetime,
    days: int,
    hosts: Sequence[str] = (),
    key_before: bytes | None = None,
) -> Pair:
    """A certificate signed by the authority.

    Args:
        authority: of `new_authority`.
        name: the common name: ROLE.NAME of a client, or `gateway`.
        now: in UTC.
        days: how long it is valid.
        hosts: names and addresses of a server; empty for a client.
        key_before: private key that it keeps, as PEM; None: a new one.

    Raises:
        ConfigError: a host is neither a name nor an address.
    """
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    issuer_key = _loaded(authority.key)
    key = _loaded(key_before) if key_before else ec.generate_private_key(ec.SECP256R1())
    builder = _builder(
        _name(name), issuer.subject, key.public_key(), issuer_key.public_key(), now, days
    )
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
    builder = builder.add_extension(_usage(signs_certificates=False), critical=True)
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
    builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
    if hosts:
        names = x509.SubjectAlternativeName([_host(one) for one in hosts])
        builder = builder.add_extension(names, critical=False)
    return _pair(builder.sign(issuer_key, hashes.SHA256()), key)


def hosts_of(certificate: bytes) -> tuple[str, ...]:
    """Names and addresses in a server's certificate, as PEM."""
    extensions = x509.load_pem_x509_certificate(certificate).extensions
    names = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(one.value) for one in names)


def _loaded(pem: bytes) -> ec.EllipticCurvePrivateKey:
    key = load_pem_private_key(pem, None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise TypeError(f"a key is a {type(key).__name__}, not of a curve")
    return key


def _builder(
    name: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    issuer_key: ec.EllipticCurvePublicKey,
    now: datetime.datetime,
    days: int,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key), critical=False
        )
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise ConfigError(COMMAND_LINE, "--host", host, "a name in ASCII, or an address") from error


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _pair(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Pair:
    return Pair(
        certificate.public_bytes(Encoding.PEM),
        key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
    )
