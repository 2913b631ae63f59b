"""A virtual trainer whose service has keys, and its clients."""

import datetime
import json

from keyed_gateway import target_of

from daemon.keys import issuing
from gaitd_lab.processes import free_port
from gaitd_lab.testing.trainer import VirtualTrainer

NOW = datetime.datetime.now(datetime.UTC)


class TrainerWithKeys(VirtualTrainer):
    """A virtual trainer; each request is made by one of its clients, at first by the first."""

    def __init__(self, folder, clients, configs=None, **given):
        """`clients`: whether each is remote, by name."""
        tls = f"tls/localhost:{free_port()}"
        super().__init__(folder, configs, **given)
        text = self.config.read_text(encoding="utf-8")
        local = self.target.endpoints[0]
        with_keys = f'listen = ["{local}", "{tls}"]\nkeys = "keys"'
        text = text.replace(f'listen = ["{local}"]', with_keys)
        self.config.write_text(text, encoding="utf-8")
        self.keys = self.config.parent / "keys"
        issuing.init(self.keys, self.trainer, [], NOW, 365)
        for name, is_remote in clients.items():
            endpoints = [tls if is_remote else local]
            issuing.issue(self.keys, name, endpoints, self.trainer, NOW, 365, remote=is_remote)
        self.act_as(next(iter(clients)))

    def credentials(self, name):
        """The folder of a client."""
        return self.keys / issuing.ISSUED / name

    def act_as(self, name):
        self.target = target_of(self.credentials(name))

    def asked(self):
        """Name and client of each request in the request log."""
        lines = (self.folder / "state" / "requests.jsonl").read_text().splitlines()
        logged = [json.loads(line) for line in lines]
        return [(one["name"], one["client"]) for one in logged if "client" in one]
