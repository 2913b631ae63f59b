"""init, issue, renew and revoke: the only writer of the folder of keys.

A change is written at once. The gateway reads the folder at its start only, so the change takes
effect with its next restart (`gaitd keys apply`).

Every file is replaced as a whole and readable by its owner alone. Root makes the gateway's user,
who owns the folder, the owner of the files; the authority's key stays root's.
"""

import datetime
import os
import re
import secrets
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from daemon.config.strict import ConfigError
from daemon.keys.certificates import Pair, new_authority, new_certificate
from daemon.keys.credentials import FILE, CredentialsFile
from daemon.keys.folder import (
    AUTHORITY,
    CLIENTS,
    GATEWAY,
    ISSUED,
    PASSWORDS,
    Client,
    Keys,
    Register,
    read_keys,
)
from daemon.wire.roles import IDENTITY

ALLOWED_NAME: Final = (
    "ROLE.NAME; roles are display, controller, session, operator, service;"
    " the name has up to 32 of a-z 0-9 _ -"
)
LOCAL_HOSTS: Final = ("localhost", "127.0.0.1", "::1")
PASSWORD_BYTES: Final = 24


def init(
    folder: Path, trainer: str, hosts: Sequence[str], now: datetime.datetime, days: int
) -> Keys:
    """Make a folder with an authority and the gateway's certificate; no client may connect yet.

    Raises:
        ConfigError: the folder has keys already.
    """
    if (folder / CLIENTS).exists():
        raise ConfigError(folder / CLIENTS, "", "", "it exists: init would lock out every client")
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    authority = new_authority(trainer, now)
    keys = Keys(folder, Register(gateway_expires=_date(now, days)))
    _write_pair(keys, AUTHORITY, authority, gateways=False)
    _write(keys.certificate(AUTHORITY), authority.certificate)
    gateway = new_certificate(authority, GATEWAY, now, days, (*LOCAL_HOSTS, *hosts))
    _write_pair(keys, GATEWAY, gateway)
    _write_register(keys, {})
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
    """Issue credentials, or new ones for the same name: the old ones end with the next restart.

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
        ConfigError: no such role, or the folder cannot be used.
    """
    if not re.fullmatch(IDENTITY, name):
        raise ConfigError("command line", "NAME", name, ALLOWED_NAME)
    keys = read_keys(folder)
    password = secrets.token_urlsafe(PASSWORD_BYTES)
    expires = _date(now, days) if remote else None
    client = Client(name=name, remote=remote, issued=f"{now:%Y-%m-%d}", expires=expires)
    bundle = folder / ISSUED / name
    shutil.rmtree(bundle, ignore_errors=True)
    for made in (bundle.parent, bundle):
        made.mkdir(mode=0o700, exist_ok=True)
    file = CredentialsFile(
        name=name,
        password=password,
        endpoints=tuple(endpoints),
        trainer=trainer,
        is_remote=remote,
    )
    _write(bundle / FILE, msgspec.json.format(msgspec.json.encode(file)))
    if remote:
        authority = Pair(keys.certificate(AUTHORITY).read_bytes(), keys.key(AUTHORITY).read_bytes())
        pair = new_certificate(authority, name, now, days)
        of_client = Keys(bundle, keys.register)
        _write_pair(of_client, "client", pair)
        _write(of_client.certificate(AUTHORITY), authority.certificate)
    others = tuple(one for one in keys.register.clients if one.name != name)
    register = msgspec.structs.replace(keys.register, clients=(*others, client))
    _write_register(Keys(folder, register), {**_passwords(keys), name: password})
    return bundle


def renew_gateway(folder: Path, hosts: Sequence[str], now: datetime.datetime, days: int) -> None:
    """Issue a new certificate for the gateway.

    Raises:
        ConfigError: the folder cannot be used.
    """
    keys = read_keys(folder)
    authority = Pair(keys.certificate(AUTHORITY).read_bytes(), keys.key(AUTHORITY).read_bytes())
    _write_pair(
        keys, GATEWAY, new_certificate(authority, GATEWAY, now, days, (*LOCAL_HOSTS, *hosts))
    )
    register = msgspec.structs.replace(keys.register, gateway_expires=_date(now, days))
    _write_register(Keys(folder, register), _passwords(keys))


def revoke(folder: Path, name: str) -> None:
    """Remove a client.

    Raises:
        ConfigError: there is no such client, or the folder cannot be used.
    """
    keys = read_keys(folder)
    left = tuple(one for one in keys.register.clients if one.name != name)
    if len(left) == len(keys.register.clients):
        known = ", ".join(one.name for one in left) or "none is issued"
        raise ConfigError("command line", "NAME", name, f"one of: {known}")
    shutil.rmtree(folder / ISSUED / name, ignore_errors=True)
    passwords = {user: word for user, word in _passwords(keys).items() if user != name}
    _write_register(Keys(folder, msgspec.structs.replace(keys.register, clients=left)), passwords)


def _date(now: datetime.datetime, days: int) -> str:
    return f"{now + datetime.timedelta(days=days):%Y-%m-%d}"


def _passwords(keys: Keys) -> dict[str, str]:
    lines = keys.passwords.read_text("utf-8").splitlines()
    return {line.partition(":")[0]: line.partition(":")[2] for line in lines}


def _write_register(keys: Keys, passwords: dict[str, str]) -> None:
    # Passwords last: a gateway that starts between the two refuses the folder and says why.
    data = msgspec.json.format(msgspec.json.encode(keys.register))
    _write(keys.folder / CLIENTS, data)
    lines = "".join(f"{name}:{password}\n" for name, password in sorted(passwords.items()))
    _write(keys.folder / PASSWORDS, lines.encode())


def _write_pair(keys: Keys, name: str, pair: Pair, *, gateways: bool = True) -> None:
    _write(keys.certificate(name), pair.certificate, gateways=gateways)
    _write(keys.key(name), pair.key, gateways=gateways)


def _write(path: Path, data: bytes, *, gateways: bool = True) -> None:
    """Replace a file as a whole, readable by its owner alone."""
    new = path.with_name(f".{path.name}.new")
    new.unlink(missing_ok=True)
    file = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        os.write(file, data)
        if gateways and os.geteuid() == 0:
            owner = path.parent.stat()
            os.fchown(file, owner.st_uid, owner.st_gid)
        os.fsync(file)
    finally:
        os.close(file)
    new.replace(path)
