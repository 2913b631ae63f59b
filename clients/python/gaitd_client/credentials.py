"""What a client presents: a folder `issued/NAME` of `gaitd keys`, copied to where it is needed.

credentials.json                   name, password, endpoints, trainer
client.pem client.key authority.pem   of a remote client: its certificate, and the authority
"""

from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from gaitd_client.errors import CredentialsError

FILE: Final = "credentials.json"
"""Name of the file in a folder of credentials that says which they are."""


class CredentialsFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of `credentials.json`."""

    name: str
    password: str
    endpoints: tuple[str, ...]
    trainer: str
    is_remote: bool


class Credentials(NamedTuple):
    """The folder and its file."""

    folder: Path
    file: CredentialsFile

    def settings(self) -> dict[str, Any]:
        """Keys of Zenoh's configuration of a client."""
        user = {"user": self.file.name, "password": self.file.password}
        if not self.file.is_remote:
            return {"transport/auth/usrpwd": user}
        folder = self.folder.resolve()
        tls = {
            "root_ca_certificate": str(folder / "authority.pem"),
            "enable_mtls": True,
            "connect_certificate": str(folder / "client.pem"),
            "connect_private_key": str(folder / "client.key"),
            "verify_name_on_connect": True,
        }
        return {"transport/auth/usrpwd": user, "transport/link/tls": tls}


def read_credentials(folder: Path) -> Credentials:
    """Read the folder that `gaitd keys issue` made.

    Raises:
        CredentialsError: it cannot be read, or is none.
    """
    path = folder / FILE
    try:
        return Credentials(folder, msgspec.json.decode(path.read_bytes(), type=CredentialsFile))
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise CredentialsError(path, f"{reason}; `gaitd keys issue` makes it") from error
    except (ValueError, RecursionError) as error:
        raise CredentialsError(path, f"{error}; `gaitd keys issue` makes it") from error
