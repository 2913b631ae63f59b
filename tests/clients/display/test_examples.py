"""The examples in JavaScript and C run; where a language is not installed they are skipped."""

import json
import shutil
import subprocess
import time

import browser as rig
import display_bench as bench
import msgspec
import pytest
import zenoh
from documents import PROJECT
from gaitd_client import Activity, wire
from gaitd_display.engineer import EngineerServer

from gaitd_lab.processes import free_port

CLIENTS = PROJECT / "clients"
WITHIN_S = 60


def flags_of_zenoh_pico():
    if shutil.which("gcc") is None or shutil.which("pkg-config") is None:
        return None
    words = ["pkg-config", "--cflags", "--libs", "zenohpico"]
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    return None if found.returncode else found.stdout.split()


def test_node_prints_the_torque_and_ends(tmp_path):
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    probe = ["node", "--experimental-websocket", "-e", "WebSocket"]
    if subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("this node has no WebSocket: 20.10 or newer")
    shutil.copy(CLIENTS / "javascript/print.mjs", tmp_path)
    shutil.copy(CLIENTS / "display/gaitd_display/static/gaitd.mjs", tmp_path)
    trainer = bench.MessageTrainer()
    with (
        rig.Site(
            lambda made: EngineerServer(made, trainer, lambda: bench.BEGAN_NS),
            bench.engineer_table(),
            tmp_path,
            rig.KINDS["engineer"],
        ) as site,
        rig.Player(trainer) as player,
    ):
        player.play(mode="gait", power_w=4.0)
        command = ["node", *probe[1:2], "print.mjs", site.address, "3"]
        ended = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=WITHIN_S, check=False
        )
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert lines[0] == "no signal: connecting"
    assert lines[-3:] == ["8.0 N·m"] * 3


def test_c_prints_the_torque_or_that_it_is_unknown(tmp_path):
    flags = flags_of_zenoh_pico()
    if flags is None:
        pytest.skip("gcc, pkg-config or zenoh-pico is not installed: docs/other_languages.md")
    program = tmp_path / "torque"
    source = CLIENTS / "c/torque.c"
    build = ["gcc", "-Wall", "-Wextra", "-Werror", "-DZENOH_LINUX", str(source), "-o", str(program)]
    folders = [flag.removeprefix("-L") for flag in flags if flag.startswith("-L")]
    rpath = [f"-Wl,-rpath,{folder}" for folder in folders]
    subprocess.run([*build, *flags, *rpath], check=True)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    found = []
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(wire.key("trainer", "right", "activity"))
        with subprocess.Popen([program, endpoint], stdout=subprocess.PIPE, text=True) as reader:
            while not publisher.matching_status.matching:
                assert reader.poll() is None
                time.sleep(0.01)
            for torque_nm in (8.0, None):
                activity = bench.filled(Activity, hip={"patient": torque_nm})
                publisher.put(msgspec.json.encode(activity))
                found.append(reader.stdout.readline().strip())
            reader.kill()
    assert found == ["8.0 N·m", "unknown"]
