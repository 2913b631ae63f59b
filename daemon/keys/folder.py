"""The folder of keys, as the gateway reads it at its start.

    clients.json                 who may connect: name, kind of link, dates
    passwords                    NAME:PASSWORD of each client, as Zenoh reads it
    gateway.pem  gateway.key     the gateway's certificate
    authority.pem authority.key  the authority that signs certificates; the gateway needs no key
    issued/NAME/                 what a client gets: `credentials.py`

A local client proves its name by a password, which has no date, so a wrong clock locks no local
client out. A remote client proves it by a certificate and a password. A client that is not in
`clients.json` cannot connect, whatever certificate it has: that is how one is revoked.
"""

import stat
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
from msgspec import Meta

from daemon.config.strict import ConfigError
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import Role
from daemon.wire.roles import IDENTITY, role_of

CLIENTS: Final = "clients.json"
PASSWORDS: Final = "passwords"
GATEWAY: Final = "gateway"
AUTHORITY: Final = "authority"
ISSUED: Final = "issued"
CERTIFICATE_SUFFIX: Final = ".pem"
KEY_SUFFIX: Final = ".key"
REMEDY: Final = "`gaitd keys init` makes the folder, `gaitd keys issue` adds a client"

Date = Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class Client(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A client that may connect."""

    name: Annotated[str, Meta(pattern=f"^{IDENTITY}$")]
    """ROLE.NAME."""
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

    gateway_expires: Date
    clients: tuple[Client, ...] = ()


class Keys(NamedTuple):
    """The folder and its register."""

    folder: Path
    register: Register

    @property
    def passwords(self) -> Path:
        """Zenoh's dictionary of users."""
        return self.folder / PASSWORDS

    def certificate(self, name: str) -> Path:
        """A certificate of this folder: GATEWAY or AUTHORITY."""
        return self.folder / f"{name}{CERTIFICATE_SUFFIX}"

    def key(self, name: str) -> Path:
        """The private key to the certificate of the same name."""
        return self.folder / f"{name}{KEY_SUFFIX}"


_DECODER: Final = Decoder(msgspec.json.Decoder(Register).decode)


def read_keys(folder: Path) -> Keys:
    """Read and check the folder.

    Raises:
        ConfigError: a file is missing, cannot be read, or is readable by others; a name stands
            twice, or has no password.
    """
    path = folder / CLIENTS
    try:
        keys = Keys(folder, _DECODER.decode(_read(path)))
    except RefusedError as error:
        raise ConfigError(path, "", "", f"{error}; {REMEDY}") from error
    names = [client.name for client in keys.register.clients]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(path, "clients.name", name, "each name once")
    for secret in (keys.passwords, keys.key(GATEWAY)):
        _read(secret)
        if secret.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            mode = f"{secret.stat().st_mode & 0o777:04o}"
            raise ConfigError(secret, "mode", mode, "0600: only its owner may read it")
    users = [line.partition(":")[0] for line in keys.passwords.read_text("utf-8").splitlines()]
    if sorted(users) != sorted(names):
        differing = ", ".join(sorted(set(users) ^ set(names)))
        raise ConfigError(keys.passwords, "names", differing, f"the same names as in {path.name}")
    return keys


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise ConfigError(path, "", "", f"{reason}; {REMEDY}") from error
