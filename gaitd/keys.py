"""`gaitd keys init|issue|list|renew|revoke|apply`: which clients may connect, and as what.

All but `apply` work on the folder `[zenoh] keys` of the trainer file, without a service. The
gateway reads the folder at its start: `apply` requests its restart, which is refused while the
machine is active or stopping.
"""

import datetime
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from daemon.config.trainer import TrainerFile, load_trainer
from daemon.keys import issuing
from daemon.keys.folder import GATEWAY, Keys, read_keys
from daemon.system.files import make_folder
from daemon.zenoh_io.endpoints import TLS, to_connect
from gaitd.command_line import ConfigFile, JsonOption, errors_in_one_line, json_on_stdout
from gaitd.remote import CredentialsOption, find_target, request
from gaitd.terminal import show

DAYS: Final = 365


class Action(StrEnum):
    """Subcommand of `gaitd keys`."""

    INIT = "init"
    ISSUE = "issue"
    LIST = "list"
    RENEW = "renew"
    REVOKE = "revoke"
    APPLY = "apply"


Name = Annotated[
    str | None, typer.Argument(metavar="[NAME]", help="ROLE.NAME, or gateway for renew")
]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", help="Name or address of this machine for remote clients; repeatable."),
]


def command(
    action: Annotated[Action, typer.Argument(help="What to do.")],
    config: ConfigFile,
    name: Name = None,
    remote: Annotated[
        bool, typer.Option("--remote", help="issue: for another machine, with a certificate.")
    ] = False,
    host: Hosts = None,
    days: Annotated[int, typer.Option(help="Validity of a certificate.", min=1, max=3650)] = DAYS,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Keys of clients: display, controller, session, operator and service."""
    file = load_trainer(config)
    if file.keys is None:
        allowed = "a folder, for example keys"
        raise ConfigError(config, "zenoh.keys", MISSING, allowed, following="")
    if action is Action.APPLY:
        target = find_target(config, None, None, credentials)
        raise typer.Exit(request(target, "restart", as_json=as_json))
    folder = Folder(file, file.keys, datetime.datetime.now(datetime.UTC), host or [], days)
    with errors_in_one_line():
        if action is Action.INIT:
            make_folder(folder.keys)
        with issuing.changing(folder.keys), json_on_stdout(as_json) as write:
            _act(action, folder, name, write, remote=remote)


class Folder(NamedTuple):
    """The folder of keys, and what the command line says of certificates."""

    file: TrainerFile
    keys: Path
    now: datetime.datetime
    hosts: list[str]
    days: int


def _act(
    action: Action,
    folder: Folder,
    name: str | None,
    write: Callable[[object], None],
    *,
    remote: bool,
) -> None:
    file, keys, now, hosts, days = folder
    match action:
        case Action.INIT:
            issuing.init(keys, file.trainer.zenoh.trainer, hosts, now, days)
            print(f"{keys}: made. No client may connect yet: `gaitd keys issue ROLE.NAME`.")
        case Action.ISSUE:
            _issue(folder, _given(name), remote=remote)
        case Action.RENEW:
            _renew(folder, _given(name))
        case Action.REVOKE:
            issuing.revoke(keys, _given(name))
            print(f"{name}: may not connect after the next `gaitd keys apply`.")
        case _:
            _list(read_keys(keys), write)
            return
    write({"action": action, "name": name, "folder": keys, "next": "gaitd keys apply"})


def _given(name: str | None) -> str:
    if name is None:
        raise ConfigError(COMMAND_LINE, "NAME", MISSING, issuing.ALLOWED_NAME)
    return name


def _issue(folder: Folder, name: str, *, remote: bool) -> None:
    file, keys, now, hosts, days = folder
    listen = file.trainer.zenoh.listen
    ours = [one for one in listen if one.startswith(f"{TLS}/") == remote]
    if not ours:
        wanted = "a tls/ endpoint" if remote else "an endpoint of this machine"
        raise ConfigError(file.path, "zenoh.listen", list(listen), wanted, following="")
    known = hosts or list(issuing.remote_hosts(keys)) if remote else []
    endpoints = [_reachable(one, known) if remote else to_connect(one) for one in ours]
    trainer = file.trainer.zenoh.trainer
    bundle = issuing.issue(keys, name, endpoints, trainer, now, days, remote=remote)
    print(f"{bundle}: copy this folder to the client, readable by it alone.")
    print(
        "It takes effect with `gaitd keys apply`; until then the one before is valid"
        f" ({bundle.name}.before, if there was one).",
        file=sys.stderr,
    )


def _reachable(endpoint: str, hosts: list[str]) -> str:
    """The endpoint for another machine: with the first host in place of `every address`.

    Raises:
        ConfigError: no host is known.
    """
    if to_connect(endpoint) == endpoint:
        return endpoint
    if not hosts:
        allowed = f"a name of this machine for other machines, in place of {endpoint}"
        raise ConfigError(COMMAND_LINE, "--host", MISSING, allowed)
    host = f"[{hosts[0]}]" if ":" in hosts[0] else hosts[0]
    return f"{TLS}/{host}:{endpoint.rpartition(':')[2]}"


def _renew(folder: Folder, name: str) -> None:
    if name == GATEWAY:
        issuing.renew_gateway(folder.keys, folder.hosts, folder.now, folder.days)
        print("gateway: a new certificate. It takes effect with `gaitd keys apply`.")
        return
    known = {client.name: client for client in read_keys(folder.keys).register.clients}
    if name not in known:
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of: gateway, {', '.join(known)}")
    _issue(folder, name, remote=known[name].remote)


def _list(keys: Keys, write: Callable[[object], None]) -> None:
    clients = keys.register.clients
    objects = [
        {"name": c.name, "remote": c.remote, "issued": c.issued, "expires": c.expires}
        for c in clients
    ]
    write({"gateway_expires": keys.register.gateway_expires, "clients": objects})
    links = {True: "TLS, certificate and password", False: "this machine, password"}
    rows = [(c.name, links[c.remote], c.issued, c.expires or "never") for c in clients]
    last = (GATEWAY, "", "", keys.register.gateway_expires)
    show([(str(keys.folder), ("client", "link", "issued", "expires"), (*rows, last))])
