"""Settings of a server: one strict TOML file for each of the three.

There is no default for a value that a person must decide: the target band, the drift that is
harmless, how to call for help, and how to get out of the straps.
"""

import ipaddress
import tomllib
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import msgspec
from gaitd_client import Credentials, read_credentials
from gaitd_client.numbers import not_finite
from msgspec import Meta

LOOPBACK_NAMES: Final = frozenset({"localhost"})


class SettingsError(Exception):
    """A file cannot be used; the text names file, key, value and what is allowed."""


class Spoken(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One text in both languages."""

    en: Annotated[str, Meta(min_length=1, max_length=400)]
    de: Annotated[str, Meta(min_length=1, max_length=400)]


class Web(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the pages are served."""

    host: Annotated[str, Meta(min_length=1)]
    """Address to bind: 127.0.0.1, another one, or 0.0.0.0."""
    port: Annotated[int, Meta(ge=0, le=65535)]
    certificate: Path | None = None
    """PEM file; mandatory with another address than loopback."""
    key: Path | None = None
    origins: tuple[str, ...] = ()
    """Origins of the pages beyond loopback, for example https://trainer.lan:8443."""

    @property
    def is_loopback(self) -> bool:
        """True if only programs of this machine reach it."""
        if self.host in LOOPBACK_NAMES:
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def is_tls(self) -> bool:
        """True if connections are encrypted."""
        return self.certificate is not None

    @property
    def allowed_origins(self) -> frozenset[str]:
        """Origins whose pages may connect and send requests."""
        if self.origins:
            return frozenset(self.origins)
        scheme = "https" if self.is_tls else "http"
        return frozenset(f"{scheme}://{name}:{self.port}" for name in ("127.0.0.1", "localhost"))


class Link(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The service that is shown."""

    endpoint: str | None = None
    """Zenoh endpoint; None: that of the credentials, or tcp/127.0.0.1:7447."""
    credentials: Path | None = None
    """Folder of `gaitd keys issue`; None: the service has no keys."""
    trainer: str | None = None

    def read_credentials(self) -> Credentials | None:
        """Read the folder; None without keys."""
        return None if self.credentials is None else read_credentials(self.credentials)


Watts = Annotated[float, Meta(ge=0.1, le=500)]


class Bar(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The bar of one leg: power of the patient, positive with the motion."""

    leg: Literal["right", "left"]
    target_low_w: Watts
    target_high_w: Watts
    full_w: Watts
    """Power at the upper end of the bar."""


Language = Literal["en", "de"]


class Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the pages say."""

    language: Language
    """At start; a button on the page changes it."""
    help: Spoken
    """How to call for help, for example a telephone number."""
    unstrap: Spoken
    """How to get out of the straps of this machine."""


class WayOutRules(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a leg without power moves so little that the patient may release it alone."""

    check: Path
    """Output of `gaitd check --json` for the configuration of the running service."""
    hip_drift_max_deg: Annotated[float, Meta(ge=0, le=10)]
    slide_drift_max_m: Annotated[float, Meta(ge=0, le=0.1)]


class SessionFiles(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The patient's profile, and the history of the sessions."""

    profile: Path
    """File of `gaitd-session new-profile`."""
    history: Path
    """SQLite file of the patient's server, which makes it if it does not exist."""


class PatientSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file of the patient's server."""

    web: Web
    trainer: Link
    page: Page
    bar: Annotated[tuple[Bar, ...], Meta(min_length=1, max_length=2)]
    way_out: WayOutRules | None = None
    """None: the page never offers RESET."""
    session: SessionFiles | None = None
    """None: a gait is started by another program."""


class Login(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The login of the therapist's server."""

    password_hash: Annotated[str, Meta(pattern=r"^scrypt\$")]
    """Output of `gaitd-display password`."""
    session_max_min: Annotated[int, Meta(ge=1, le=720)] = 60
    """A session ends after this time, in any case."""


class TherapistSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file of the therapist's server."""

    web: Web
    trainer: Link
    login: Login
    language: Language
    legs: Annotated[tuple[Literal["right", "left"], ...], Meta(min_length=1, max_length=2)]
    session: SessionFiles | None = None
    """None: the page shows no profile and no progress."""


class EngineerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file of the engineer's server."""

    web: Web
    trainer: Link
    truth: Path | None = None
    """File of `gaitd sim --truth`; None: the drives are real, and there is no truth."""


File = TypeVar("File", PatientSettings, TherapistSettings, EngineerSettings)


def read_settings(path: Path, kind: type[File]) -> File:
    """Read a file; relative paths in it are relative to its folder.

    Raises:
        SettingsError: it cannot be read, a key is wrong, or TLS is missing beyond loopback.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        for key, value in not_finite(table):
            raise SettingsError(f"{path}: {key} = {value}: a finite number is needed")
        settings = msgspec.convert(table, kind, dec_hook=lambda _, text: path.parent / str(text))
    except OSError as error:
        raise SettingsError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from error
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: {error}") from error
    _refuse_web(path, settings.web)
    if isinstance(settings, PatientSettings):
        _refuse_bars(path, settings.bar)
        if settings.session is not None and not settings.web.is_loopback:
            raise SettingsError(
                f"{path}: session with web.host = {settings.web.host!r}: a page without login may "
                "start a training on the machine's own screen only; bind 127.0.0.1"
            )
    if isinstance(settings, EngineerSettings) and not settings.web.is_loopback:
        raise SettingsError(
            f"{path}: web.host = {settings.web.host!r}: this page shows a patient's data without "
            "login; bind 127.0.0.1, and reach it from another machine through a tunnel of SSH"
        )
    return settings


def _refuse_web(path: Path, web: Web) -> None:
    if (web.certificate is None) != (web.key is None):
        raise SettingsError(f"{path}: web.certificate and web.key belong together; give both")
    if web.is_loopback:
        return
    if web.certificate is None:
        raise SettingsError(
            f"{path}: web.host = {web.host!r} can be reached from other machines: give "
            "web.certificate and web.key, or bind 127.0.0.1"
        )
    if not web.origins or not all(origin.startswith("https://") for origin in web.origins):
        raise SettingsError(
            f"{path}: web.origins = {list(web.origins)} with web.host = {web.host!r}: list the "
            "addresses of the pages, such as https://trainer.lan:8443"
        )


def _refuse_bars(path: Path, bars: tuple[Bar, ...]) -> None:
    for bar in bars:
        if not bar.target_low_w < bar.target_high_w <= bar.full_w:
            raise SettingsError(
                f"{path}: bar of leg {bar.leg}: target_low_w = {bar.target_low_w:g}, target_high_w"
                f" = {bar.target_high_w:g}, full_w = {bar.full_w:g}, allowed low < high <= full"
            )
    if len({bar.leg for bar in bars}) != len(bars):
        raise SettingsError(f"{path}: bar: one for each leg, {[bar.leg for bar in bars]} given")
