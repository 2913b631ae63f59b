"""The folder of keys, as the gateway reads it at its start.

    clients.json                 who may connect: name, password, kind of link, dates
    gateway.pem  gateway.key     the gateway's certificate
    authority.pem authority.key  the authority that signs certificates; the gateway needs no key
    issued/NAME/                 what a client gets: `credentials.py`

A local client proves its name by a password, which has no date, so a wrong clock locks no local
client out. A remote client needs a certificate of the authority and a password. Who has no password
of `clients.json` cannot connect, whatever certificate it shows: that is how a client is revoked.
"""

import ssl
import stat
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
from gaitd_names import Role
from gaitd_toml import ConfigError
from msgspec import Meta

from daemon.ipc.decoding import Decoder, RefusedError
from daemon.wire.roles import IDENTITY, role_of

CLIENTS: Final = "clients.json"
GATEWAY: Final = "gateway"
AUTHORITY: Final = "authority"
ISSUED: Final = "issued"
REMEDY: Final = "`gaitd keys init` makes the folder, `gaitd keys issue` adds a client"

Date = Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class Client(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A client that may connect."""

    name: Annotated[str, Meta(pattern=f"^{IDENTITY}$")]
    """ROLE.NAME."""
    password: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{16,64}$")]
    remote: bool
    """True: by TLS, with a certificate; false: on this machine, by password alone."""
    issued: Date
    expires: Date | None = None
    """Last day of the certificate; None: there is none."""

    @property
    def role(self) -> Role:
        """The role in the name."""
        return role_of(self.name)


class Register(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of `clients.json`."""

    authority_expires: Date
    gateway_expires: Date
    clients: tuple[Client, ...] = ()


class Keys(NamedTuple):
    """The folder and its register."""

    folder: Path
    register: Register

    def certificate(self, name: str) -> Path:
        """A certificate of this folder: GATEWAY or AUTHORITY."""
        return self.folder / f"{name}.pem"

    def key(self, name: str) -> Path:
        """The private key to the certificate of the same name."""
        return self.folder / f"{name}.key"


_DECODER: Final = Decoder(msgspec.json.Decoder(Register).decode)


def read_keys(folder: Path) -> Keys:
    """Read and check the folder.

    Raises:
        ConfigError: a file is missing, cannot be read or used, or a secret is readable by others;
            a name stands twice.
    """
    path = folder / CLIENTS
    try:
        keys = Keys(folder, _DECODER.decode(path.read_bytes()))
    except OSError as error:
        raise _unusable(path, error) from error
    except RefusedError as error:
        raise ConfigError(path, "", "", f"{error}; {REMEDY}", following="") from error
    names = [client.name for client in keys.register.clients]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(path, "clients.name", name, "each name once", following="")
    for secret in (path, keys.key(GATEWAY), keys.key(AUTHORITY)):
        # The authority's key may be kept elsewhere; the others have been read, or will be.
        mode = secret.stat().st_mode if secret.exists() else 0
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            allowed = "0600: only its owner may read it"
            raise ConfigError(secret, "mode", f"{mode & 0o777:04o}", allowed, following="")
    _check_certificates(keys)
    return keys


def _check_certificates(keys: Keys) -> None:
    """What OpenSSL cannot load, Zenoh could not either, and the gateway would not start."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    certificate, authority = keys.certificate(GATEWAY), keys.certificate(AUTHORITY)
    try:
        context.load_cert_chain(certificate, keys.key(GATEWAY))
    except OSError as error:
        raise _unusable(certificate, error) from error
    try:
        context.load_verify_locations(authority)
    except OSError as error:
        raise _unusable(authority, error) from error


def _unusable(path: Path, error: OSError) -> ConfigError:
    reason = (error.strerror or str(error) or "cannot be read").lower()
    return ConfigError(path, "", "", f"{reason}; {REMEDY}", following="")
