"""init, issue, renew and revoke: the only writer of the folder of keys.

A change is written at once, in one file (`clients.json`), which is replaced as a whole. The gateway
reads the folder at its start only, so the change takes effect with its next restart (`gaitd keys
apply`). Until then the credentials before a renewal stay valid; they are kept in `NAME.before`.

A power cut leaves the register as it was before the command or after it. A certificate and its key
are two files: so the gateway's key stays when its certificate is renewed, and what a client gets is
listed last, in the register. Files of a command that did not come to its end are in no register.

Every file is readable by its owner alone. Root makes the gateway's user, who owns the folder, the
owner of the files; the authority's key stays root's.
"""

import contextlib
import datetime
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Final

import msgspec
from gaitd_client.credentials import FILE, CredentialsFile
from gaitd_toml import COMMAND_LINE, ConfigError

from daemon.keys.certificates import (
    AUTHORITY_DAYS,
    Pair,
    hosts_of,
    new_authority,
    new_certificate,
)
from daemon.keys.folder import (
    AUTHORITY,
    CLIENTS,
    GATEWAY,
    ISSUED,
    Client,
    Keys,
    Register,
    read_keys,
)
from daemon.system.files import make_folder, replace_file, sync_folder
from daemon.wire.roles import IDENTITY

ALLOWED_NAME: Final = (
    "ROLE.NAME; roles are display, controller, session, operator, service;"
    " the name has up to 32 of a-z 0-9 _ -"
)
LOCAL_HOSTS: Final = ("localhost", "127.0.0.1", "::1")
PASSWORD_BYTES: Final = 24


@contextlib.contextmanager
def changing(folder: Path) -> Generator[None]:
    """Keep every other command out of the folder meanwhile."""
    file = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
    finally:
        os.close(file)


def init(
    folder: Path, trainer: str, hosts: Sequence[str], now: datetime.datetime, days: int
) -> Keys:
    """Make a folder with an authority and the gateway's certificate; no client may connect yet.

    Raises:
        ConfigError: the folder has keys already, or a host is no name.
    """
    if (folder / CLIENTS).exists():
        allowed = "it exists: init would lock out every client"
        raise ConfigError(folder / CLIENTS, "", "", allowed, following="gaitd keys list")
    authority = new_authority(trainer, now)
    gateway = new_certificate(authority, GATEWAY, now, days, (*LOCAL_HOSTS, *hosts))
    make_folder(folder)
    folder.chmod(0o700)
    register = Register(
        authority_expires=_date(now, AUTHORITY_DAYS), gateway_expires=_date(now, days)
    )
    keys = Keys(folder, register)
    _write(keys.key(AUTHORITY), authority.key, gateways=False)
    _write(keys.certificate(AUTHORITY), authority.certificate)
    _write_pair(keys, GATEWAY, gateway)
    _write_register(folder, register)
    return keys


def issue(
    folder: Path,
    name: str,
    endpoints: Sequence[str],
    trainer: str,
    now: datetime.datetime,
    days: int,
    *,
    remote: bool,
) -> Path:
    """Issue credentials, or new ones for the same name.

    Args:
        folder: of the keys.
        name: ROLE.NAME.
        endpoints: where the client connects to, for its file.
        trainer: TRAINER in the keys, for its file.
        now: in UTC.
        days: how long a certificate is valid.
        remote: for another machine, with a certificate.

    Returns:
        The folder to copy to the client.

    Raises:
        ConfigError: no such role, the folder cannot be used, or the authority ends before.
    """
    if not re.fullmatch(IDENTITY, name):
        raise ConfigError(COMMAND_LINE, "NAME", name, ALLOWED_NAME)
    keys = read_keys(folder)
    pair, authority = None, b""
    if remote:
        signer = _signer(keys, now, days)
        pair, authority = new_certificate(signer, name, now, days), signer.certificate
    password = secrets.token_urlsafe(PASSWORD_BYTES)
    bundle, before = folder / ISSUED / name, folder / ISSUED / f"{name}.before"
    make_folder(bundle.parent, 0o700)
    if bundle.exists() and _is_listed(bundle, keys.register):
        shutil.rmtree(before, ignore_errors=True)
        bundle.rename(before)
    shutil.rmtree(bundle, ignore_errors=True)
    make_folder(bundle, 0o700)
    file = CredentialsFile(
        name=name,
        password=password,
        endpoints=tuple(endpoints),
        trainer=trainer,
        is_remote=remote,
    )
    _write(bundle / FILE, msgspec.json.format(msgspec.json.encode(file)))
    if pair is not None:
        of_client = Keys(bundle, keys.register)
        _write_pair(of_client, "client", pair)
        _write(of_client.certificate(AUTHORITY), authority)
    client = Client(
        name=name,
        password=password,
        remote=remote,
        issued=f"{now:%Y-%m-%d}",
        expires=_date(now, days) if remote else None,
    )
    others = tuple(one for one in keys.register.clients if one.name != name)
    _write_register(folder, msgspec.structs.replace(keys.register, clients=(*others, client)))
    return bundle


def _is_listed(bundle: Path, register: Register) -> bool:
    """True if the credentials are those of the register, and not of a command that was cut off."""
    file = bundle / FILE
    text = file.read_bytes() if file.exists() else b""
    return any(client.password.encode() in text for client in register.clients)


def remote_hosts(folder: Path) -> tuple[str, ...]:
    """Names and addresses in the gateway's certificate by which other machines reach it.

    Raises:
        ConfigError: the folder cannot be used.
    """
    pem = read_keys(folder).certificate(GATEWAY).read_bytes()
    return tuple(host for host in hosts_of(pem) if host not in LOCAL_HOSTS)


def renew_gateway(folder: Path, hosts: Sequence[str], now: datetime.datetime, days: int) -> None:
    """Issue a new certificate for the gateway's key, for these hosts or those of the present one.

    Raises:
        ConfigError: the folder cannot be used, or the authority ends before.
    """
    keys = read_keys(folder)
    names = (*LOCAL_HOSTS, *(hosts or remote_hosts(folder)))
    key = keys.key(GATEWAY).read_bytes()
    pair = new_certificate(_signer(keys, now, days), GATEWAY, now, days, names, key)
    _write(keys.certificate(GATEWAY), pair.certificate)
    register = msgspec.structs.replace(keys.register, gateway_expires=_date(now, days))
    _write_register(folder, register)


def revoke(folder: Path, name: str) -> None:
    """Remove a client.

    Raises:
        ConfigError: there is no such client, or the folder cannot be used.
    """
    keys = read_keys(folder)
    left = tuple(one for one in keys.register.clients if one.name != name)
    if len(left) == len(keys.register.clients):
        known = ", ".join(one.name for one in left) or "none is issued"
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of: {known}")
    _write_register(folder, msgspec.structs.replace(keys.register, clients=left))
    for bundle in (name, f"{name}.before"):
        shutil.rmtree(folder / ISSUED / bundle, ignore_errors=True)
    if (folder / ISSUED).exists():
        sync_folder(folder / ISSUED)


def _signer(keys: Keys, now: datetime.datetime, days: int) -> Pair:
    end = keys.register.authority_expires
    if _date(now, days) > end:
        raise ConfigError(COMMAND_LINE, "--days", days, f"an end before the authority's, {end}")
    key = keys.key(AUTHORITY)
    if not key.exists():
        allowed = "it signs certificates: put it back for this command"
        raise ConfigError(key, "", "", allowed, following="")
    return Pair(keys.certificate(AUTHORITY).read_bytes(), key.read_bytes())


def _date(now: datetime.datetime, days: int) -> str:
    return f"{now + datetime.timedelta(days=days):%Y-%m-%d}"


def _write_register(folder: Path, register: Register) -> None:
    _write(folder / CLIENTS, msgspec.json.format(msgspec.json.encode(register)))


def _write_pair(keys: Keys, name: str, pair: Pair) -> None:
    _write(keys.certificate(name), pair.certificate)
    _write(keys.key(name), pair.key)


def _write(path: Path, data: bytes, *, gateways: bool = True) -> None:
    """Replace a file; root makes it the gateway's."""
    owner = path.parent.stat()
    is_given = gateways and os.geteuid() == 0
    replace_file(path, data, (owner.st_uid, owner.st_gid) if is_given else None)
