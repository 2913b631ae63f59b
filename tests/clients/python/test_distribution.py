"""The client library stands alone: its names, its schemas, and no need for gaitd."""

import json
import subprocess
import sys
from pathlib import Path

from gaitd_client import wire

CLIENT = Path(__file__).parents[3] / "clients" / "python"

ALONE = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ImportError(f"{name} is no dependency of gaitd-client")

BLOCKED = {"daemon", "gaitd", "gaitd_lab", "drives", "observer", "sim_drives", "simtime",
           "analysis", "numpy", "scipy", "numba", "typer", "rich", "can", "canopen", "cryptography"}
sys.meta_path.insert(0, Blocker())
import gaitd_client
from gaitd_client import NoServiceError, Trainer, wire
from gaitd_client.connection import decode_answer
reply = b'{"seq":1,"core_boot_id":null,"cycle":null,"sample_time_ns":null,"request":"stop",' \\
        b'"outcome":"done","mode":null}'
print(decode_answer(reply, wire.Reply, "stop").outcome)
try:
    with Trainer("tcp/127.0.0.1:1"):
        pass
except NoServiceError as error:
    print(error)
"""


def test_it_works_where_nothing_else_of_ours_is_installed():
    ran = subprocess.run(
        [sys.executable, "-I", "-c", ALONE], capture_output=True, text=True, check=False
    )

    assert ran.stderr == ""
    outcome, trouble = ran.stdout.splitlines()
    assert outcome == "done"
    assert trouble.startswith("no service listens on tcp/127.0.0.1:1")
    assert "Unable to connect" in trouble
    assert ".rs" not in trouble


def test_the_schemas_are_written_as_files(tmp_path):
    subprocess.run([sys.executable, "-m", "gaitd_client.wire", tmp_path / "made"], check=True)

    files = {file.name: json.loads(file.read_bytes()) for file in (tmp_path / "made").iterdir()}
    assert files.pop("asyncapi.json")["asyncapi"] == "3.0.0"
    assert files == json.loads(json.dumps({f"{n}.json": s for n, s in wire.schemas().items()}))


DECODED = """
import msgspec
from gaitd_client.wire import MESSAGES
from msgspec import _utils

def look(*_):
    raise SystemExit("msgspec looks at a type only when a message comes")

_utils._eval_type = look
for kind in MESSAGES.values():
    try:
        msgspec.json.decode(b"[]", type=kind)
    except msgspec.ValidationError:
        pass
"""


def test_types_of_messages_are_looked_at_on_import_since_two_threads_would_crash_msgspec():
    """Seen: two threads of a program asked for the status, and were the first to do so."""
    subprocess.run([sys.executable, "-I", "-c", DECODED], check=True)
