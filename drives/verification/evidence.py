"""The one file of a verification: a ZIP with everything, signed. Its reader trusts nothing in it.

Contents: `verification.json` (facts, steps, samples), `frames.log` (candump), the profile, the axis
file and the EDS as they were used, `page.html`, `sha256.json` with a digest of each, and
`signature.json`: Ed25519 (RFC 8032) over `sha256.json`, with the public key. A signature says that
nothing was changed since, and that two files come from one key. Who has the key, the sender says.
No name of a computer or of a person is in it; a serial number is that of the drive.
"""

import hashlib
import lzma
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from drives.canopen.frame import Frame
from drives.verification.bench import Row
from drives.verification.facts import Fact

RESULT, DIGESTS, SIGNATURE = "verification.json", "sha256.json", "signature.json"
FRAMES = "frames.log"
SIZE_MAX: Final = 64_000_000
"""Largest part that is read: a ZIP may promise anything."""
PARTS_MAX: Final = 16
_BROKEN: Final = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    NotImplementedError,
    RuntimeError,
    EOFError,
    UnicodeDecodeError,
)
"""What a damaged ZIP ends in, besides ValueError."""
_EARLIEST: Final = (1980, 1, 1, 0, 0, 0)
"""Time of all parts, so that equal contents are equal files."""


class EvidenceError(ValueError):
    """A file is no evidence, or was changed; the text names the file and what is wrong."""


class Result(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was verified."""

    drive: str
    node_id: int
    profile: str
    """Vendor and family of the profile."""
    identity: tuple[int, int, int, int]
    """1018h: vendor, product, revision, serial number; 0 where the drive has none."""
    gaitd_version: str
    utc: str
    """Begin, to the minute."""
    is_simulated: bool
    facts: tuple[Fact, ...]
    steps: tuple[str, ...]
    refusal: str
    rows: tuple[Row, ...]


class _Signature(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    public_key: bytes
    signature: bytes


def load_key(path: Path) -> Ed25519PrivateKey:
    """Read a private key, or make one in a file that only its owner reads.

    Raises:
        OSError: the file cannot be read or written.
        ValueError: it holds no key, one with a password, or one of another kind.
    """
    if not path.exists():
        key = Ed25519PrivateKey.generate()
        pem = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        path.touch(mode=0o600, exist_ok=False)
        path.write_bytes(pem)
        return key
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (TypeError, UnsupportedAlgorithm) as error:  # with a password; of another kind
        raise EvidenceError(f"{path}: {error}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise EvidenceError(f"{path}: {type(key).__name__}; allowed is an Ed25519 key")
    return key


def fingerprint(public_key: bytes) -> str:
    """The first half of the SHA-256 of a public key, as text."""
    return hashlib.sha256(public_key).hexdigest()[:32]


def candump(frames: Sequence[tuple[int, Frame]]) -> bytes:
    """The frames as `candump -L` writes them."""
    lines = (
        f"({time_ns / 1e9:.6f}) can0 {frame.can_id:03X}#{frame.data.hex().upper()}\n"
        for time_ns, frame in frames
        if not frame.is_error
    )
    return "".join(lines).encode()


def write(
    path: Path,
    result: Result,
    frames: Sequence[tuple[int, Frame]],
    files: Mapping[str, bytes],
    key: Ed25519PrivateKey,
) -> None:
    """Write the file.

    Args:
        path: where it goes.
        result: facts and samples.
        frames: of the bus, with their times.
        files: further parts by name: page, profile, axis file, EDS.
        key: signs.

    Raises:
        OSError: it cannot be written.
    """
    parts = {RESULT: msgspec.json.encode(result), FRAMES: candump(frames), **files}
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in sorted(parts.items())}
    parts[DIGESTS] = msgspec.json.encode(digests)
    public_key = key.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
    parts[SIGNATURE] = msgspec.json.encode(_Signature(public_key, key.sign(parts[DIGESTS])))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in sorted(parts.items()):
            packed.writestr(zipfile.ZipInfo(name, _EARLIEST), data, zipfile.ZIP_DEFLATED)


def read(path: Path) -> tuple[Result, str]:
    """Read a file whose digests and signature hold; return its result and the key's fingerprint.

    Raises:
        OSError: it cannot be opened.
        EvidenceError: it is none, or was changed.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            infos = packed.infolist()
            names = {info.filename for info in infos}
            if len(names) < len(infos) or len(names) > PARTS_MAX:
                raise EvidenceError(f"{path}: a part stands twice in it, or there are too many")
            parts = {info.filename: _part(packed, info, path) for info in infos}
    except _BROKEN as error:
        raise EvidenceError(f"{path}: it is no whole ZIP file ({error})") from error
    for name in (RESULT, DIGESTS, SIGNATURE):
        if name not in parts:
            raise EvidenceError(f"{path}: it has no {name}")
    try:
        digests = msgspec.json.decode(parts[DIGESTS], type=dict[str, str])
        signed = msgspec.json.decode(parts[SIGNATURE], type=_Signature)
        public_key = Ed25519PublicKey.from_public_bytes(signed.public_key)
        public_key.verify(signed.signature, parts[DIGESTS])
        found = {
            name: hashlib.sha256(data).hexdigest()
            for name, data in parts.items()
            if name not in (DIGESTS, SIGNATURE)
        }
        if different := sorted({*digests.items()} ^ {*found.items()}):
            raise EvidenceError(f"{path}: {different[0][0]} was changed, added or taken out")
        return msgspec.json.decode(parts[RESULT], type=Result), fingerprint(signed.public_key)
    except InvalidSignature as error:
        raise EvidenceError(f"{path}: the signature is not that of {DIGESTS}") from error
    except (msgspec.DecodeError, ValueError) as error:
        if isinstance(error, EvidenceError):
            raise
        raise EvidenceError(f"{path}: {error}") from error


def _part(packed: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> bytes:
    try:
        with packed.open(info) as file:
            data = file.read(SIZE_MAX + 1)
    except (ValueError, OSError) as error:  # OSError: a place before the file
        raise EvidenceError(f"{path}: {info.filename} cannot be read ({error})") from error
    if len(data) > SIZE_MAX:
        raise EvidenceError(f"{path}: {info.filename} has more than {SIZE_MAX} bytes")
    return data
