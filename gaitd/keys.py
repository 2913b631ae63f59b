"""`gaitd keys init|issue|list|renew|revoke|apply`: which clients may connect, and as what.

All but `apply` work on the folder `[zenoh] keys` of the trainer file, without a service. The
gateway reads the folder at its start: `apply` requests its restart, which is refused while the
machine is active or stopping.
"""

import datetime
import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import typer

from daemon.config.strict import COMMAND_LINE, MISSING, ConfigError
from daemon.config.trainer import TrainerFile, load_trainer
from daemon.keys import issuing
from daemon.keys.folder import GATEWAY, Keys, read_keys
from daemon.zenoh_io.endpoints import TLS, to_connect
from gaitd.command_line import ConfigFile
from gaitd.remote import CredentialsOption, JsonOption, find_target, request
from gaitd.terminal import show

EXIT_DONE: Final = 0
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
        raise ConfigError(config, "zenoh.keys", MISSING, "a folder, for example keys")
    now, hosts = datetime.datetime.now(datetime.UTC), host or []
    match action:
        case Action.INIT:
            issuing.init(file.keys, file.trainer.zenoh.trainer, hosts, now, days)
            print(f"{file.keys}: made. No client may connect yet: `gaitd keys issue ROLE.NAME`.")
        case Action.ISSUE:
            _issue(file, file.keys, _given(name), hosts, now, days, remote=remote)
        case Action.RENEW:
            _renew(file, file.keys, _given(name), hosts, now, days)
        case Action.REVOKE:
            issuing.revoke(file.keys, _given(name))
            print(f"{name}: may not connect after the next `gaitd keys apply`.")
        case Action.LIST:
            _list(read_keys(file.keys), as_json=as_json)
        case Action.APPLY:
            target = find_target(config, None, None, credentials)
            raise typer.Exit(request(target, "restart", as_json=as_json))
    raise typer.Exit(EXIT_DONE)


def _given(name: str | None) -> str:
    if name is None:
        raise ConfigError(COMMAND_LINE, "NAME", MISSING, issuing.ALLOWED_NAME)
    return name


def _issue(
    file: TrainerFile,
    folder: Path,
    name: str,
    hosts: list[str],
    now: datetime.datetime,
    days: int,
    *,
    remote: bool,
) -> None:
    listen = file.trainer.zenoh.listen
    ours = [one for one in listen if one.startswith(f"{TLS}/") == remote]
    if not ours:
        wanted = "a tls/ endpoint" if remote else "an endpoint of this machine"
        raise ConfigError(file.path, "zenoh.listen", list(listen), wanted)
    endpoints = [_reachable(one, hosts) if remote else to_connect(one) for one in ours]
    bundle = issuing.issue(
        folder, name, endpoints, file.trainer.zenoh.trainer, now, days, remote=remote
    )
    print(f"{bundle}: copy this folder to the client, readable by it alone.")
    print("It takes effect with `gaitd keys apply`.", file=sys.stderr)


def _reachable(endpoint: str, hosts: list[str]) -> str:
    """The endpoint with the first given host in place of `every address`."""
    here = to_connect(endpoint)
    return (
        endpoint
        if here == endpoint or not hosts
        else f"{TLS}/{hosts[0]}:{endpoint.rpartition(':')[2]}"
    )


def _renew(
    file: TrainerFile, folder: Path, name: str, hosts: list[str], now: datetime.datetime, days: int
) -> None:
    if name == GATEWAY:
        issuing.renew_gateway(folder, hosts, now, days)
        print("gateway: a new certificate. It takes effect with `gaitd keys apply`.")
        return
    known = {client.name: client for client in read_keys(folder).register.clients}
    if name not in known:
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of: gateway, {', '.join(known)}")
    _issue(file, folder, name, hosts, now, days, remote=known[name].remote)


def _list(keys: Keys, *, as_json: bool) -> None:
    clients = keys.register.clients
    if as_json:
        rows = [
            {"name": c.name, "remote": c.remote, "issued": c.issued, "expires": c.expires}
            for c in clients
        ]
        print(json.dumps({"gateway_expires": keys.register.gateway_expires, "clients": rows}))
        return
    links = {True: "TLS, certificate and password", False: "this machine, password"}
    rows = [(c.name, links[c.remote], c.issued, c.expires or "never") for c in clients]
    last = (GATEWAY, "", "", keys.register.gateway_expires)
    show([(str(keys.folder), ("client", "link", "issued", "expires"), (*rows, last))])
