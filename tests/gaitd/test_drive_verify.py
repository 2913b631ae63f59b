"""`gaitd drive verify`: from a virtual drive to a signed file, and what damages such a file."""

import contextlib
import json
import random
import zipfile

import pytest
from command_line import gaitd
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
)
from drive_bench import Bench
from sessions import changed_configs

from drives.verification import evidence
from drives.verification.facts import Fact, FactCode, Judgement
from gaitd import drive_verify
from gaitd.verification_page import ASKED
from gaitd_lab.lockstep import WorldBus, WorldClock

NAMES = {
    *("axis.toml", "drive.eds", "frames.log", "page.html", "profile.toml"),
    *("sha256.json", "signature.json", "verification.json"),
}


@pytest.fixture(name="places")
def _places(monkeypatch):
    """Places whose bus was opened: that of two virtual drives, in simulated time."""
    bench = Bench()
    bench.boot()
    bus = WorldBus(bench.world)
    places = []

    @contextlib.contextmanager
    def opened(place, *, is_master):
        assert is_master
        places.append(place)
        yield bus, WorldClock(bus)

    monkeypatch.setattr(drive_verify, "opened", opened)
    return places


BENCH = (
    ("demo.toml", 'robot = "robot.toml"', 'robot = "robot_bench.toml"'),
    ("demo.toml", 'limits = "limits.toml"', 'limits = "limits_bench.toml"'),
)


def verified(folder, *words):
    config = folder / "configs" / "demo.toml"
    if not config.exists():
        changed_configs(folder, *BENCH)
    words = ("--config", config, "--key", folder / "key.pem", "--yes", *words)
    return gaitd("drive", "verify", "hip", "--output", folder / "hip.zip", *words)


@pytest.mark.usefixtures("places")
def test_a_drive_is_verified_and_its_evidence_can_be_read(tmp_path):
    ended = verified(tmp_path, "--inertia", "2.0", "--json")
    again = verified(tmp_path)
    shown = gaitd("drive", "evidence", tmp_path / "hip.zip")
    document = json.loads(gaitd("drive", "evidence", tmp_path / "hip.zip", "--json").out)

    assert ended.code == 0, ended.err
    assert "Nothing may hang on it" in ended.err
    assert "22 passed, 3 not measured; evidence: " in ended.err
    assert (told := json.loads(ended.out))["passed"]
    assert {fact["code"] for fact in told["facts"]} == set(FactCode)
    assert again.code == 2
    assert "a file that is not there yet" in again.err
    assert shown.code == 0
    assert document["key"] in shown.out
    assert document["result"]["identity"][3] == 305_000_005
    assert (tmp_path / "key.pem").stat().st_mode & 0o777 == 0o600
    with zipfile.ZipFile(tmp_path / "hip.zip") as packed:
        assert set(packed.namelist()) == NAMES
        page = packed.read("page.html").decode()
        assert "<polyline" in page
        assert packed.read("frames.log").startswith(b"(")


def test_what_is_asked_has_a_text_each():
    assert set(ASKED) == set(FactCode)


def test_nothing_moves_without_a_confirmation(places, tmp_path):
    config = changed_configs(tmp_path, *BENCH) / "demo.toml"
    key = ("--key", tmp_path / "key.pem")

    ended = gaitd(
        "drive", "verify", "hip", "--output", tmp_path / "a.zip", "--config", config, *key
    )

    assert ended.code == 2
    assert "--yes = (missing)" in ended.err
    assert places == []
    assert not (tmp_path / "a.zip").exists()


def test_the_file_of_a_machine_with_a_leg_is_refused_before_anything_moves(places, tmp_path):
    changed_configs(tmp_path)

    ended = verified(tmp_path)

    assert ended.code == 2
    assert "robot.toml: thigh.mass_kg = 4.0: 0: a bench turns nothing" in ended.err
    assert places == []


def test_a_key_of_another_kind_is_refused_before_anything_moves(places, tmp_path):
    (tmp_path / "key.pem").write_text("no key\n")

    ended = verified(tmp_path)

    assert ended.code == 2
    assert "a file with an Ed25519 key" in ended.err
    assert places == []


# --- the file -------------------------------------------------------------------------------------


FACTS = (Fact(FactCode.SIGN, Judgement.FAILED, -0.9, (0.5, 1.0)),)


@pytest.fixture(name="written")
def _written(tmp_path):
    path = tmp_path / "one.zip"
    result = evidence.Result(
        *("right/hip", 5, "maxon EPOS4", (251, 1, 2, 3), "0.1.0", "2026-01-01T00:00Z"),
        *(True, FACTS, (), "", ()),
    )
    evidence.write(path, result, [], {"page.html": b"page"}, evidence.load_key(tmp_path / "key"))
    return path


def repacked(path, change):
    if change is None:
        with zipfile.ZipFile(path, "a") as packed, pytest.warns(UserWarning, match="Duplicate"):
            packed.writestr("page.html", b"another page")
        return
    with zipfile.ZipFile(path) as packed:
        parts = {name: packed.read(name) for name in packed.namelist()}
    change(parts)
    with zipfile.ZipFile(path, "w") as packed:
        for name, data in parts.items():
            packed.writestr(name, data)


def improved(parts):
    parts["verification.json"] = parts["verification.json"].replace(b"failed", b"passed")


def signed_anew(parts):
    digests = json.loads(parts["sha256.json"])
    digests["page.html"] = "0" * 64
    parts["sha256.json"] = json.dumps(digests).encode()


def no_signature(parts):
    signature = json.loads(parts["signature.json"])
    parts["signature.json"] = json.dumps(signature | {"public_key": "AAAA"}).encode()


DAMAGES = {
    "a fact was changed": (improved, "verification.json was changed, added or taken out"),
    "a digest was changed": (signed_anew, "the signature is not that of sha256.json"),
    "a part stands twice": (None, "a part stands twice in it"),
    "a part was added": (lambda parts: parts.update(x=b""), "x was changed, added or taken out"),
    "a part was taken out": (lambda parts: parts.pop("page.html"), "page.html was changed"),
    "no signature": (lambda parts: parts.pop("signature.json"), "it has no signature.json"),
    "a key that is none": (no_signature, "one.zip: "),
    "JSON that is none": (lambda parts: parts.update({"signature.json": b"{"}), "one.zip: "),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_file_that_was_changed_is_refused(name, written):
    change, words = DAMAGES[name]
    repacked(written, change)

    ended = gaitd("drive", "evidence", written)

    assert ended.code == 2
    assert words in ended.err


def test_a_damaged_file_is_refused_in_one_line(written):
    data = bytearray(written.read_bytes())
    dice = random.Random(48)
    for _ in range(300):
        damaged = data.copy()
        for _ in range(dice.randint(1, 4)):
            damaged[dice.randrange(len(damaged))] = dice.randrange(256)
        written.write_bytes(damaged)
        with contextlib.suppress(evidence.EvidenceError):
            evidence.read(written)


def test_a_key_with_a_password_is_refused(tmp_path):
    key = Ed25519PrivateKey.generate()
    secret = BestAvailableEncryption(b"secret")
    path = tmp_path / "key.pem"
    path.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, secret))

    with pytest.raises(evidence.EvidenceError, match=r"key.pem: Password"):
        evidence.load_key(path)


def test_a_file_with_a_failed_fact_ends_with_1_and_no_zip_with_2(written):
    failed = gaitd("drive", "evidence", written)
    written.write_bytes(b"PK")
    none = gaitd("drive", "evidence", written)
    missing = gaitd("drive", "evidence", written.parent / "missing.zip")

    assert failed.code == 1
    assert "FAILED" in failed.out
    assert none.code == 2
    assert "it is no whole ZIP file" in none.err
    assert missing.code == 2
    assert missing.err.endswith("missing.zip: No such file or directory\n")
