"""Settings of a server: one strict TOML file for each of the three.

There is no default for a value that a person must decide: the target band, the drift that is
harmless, how to call for help, and how to get out of the straps.

The patient's page is read from the chair. Its smallest text there has a cap height of
`FAR_ARC_MIN` at the configured screen; where the design is smaller it is enlarged, by up to
`TEXT_MAX_RATIO`, which the layout bears. A screen that needs more is refused.
"""

import ipaddress
import math
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import msgspec
from gaitd_client import Credentials, read_credentials
from gaitd_toml import MISSING, ConfigError, PlainText, load_toml
from msgspec import Meta

LOOPBACK_NAMES: Final = frozenset({"localhost"})
MM_PER_IN: Final = 25.4
FAR_ARC_MIN: Final = 16.0
"""ISO 9241-303: the smallest cap height that can be read; 20 to 22 are preferred."""
FAR_RATIO: Final = 0.078
"""Size of that text in parts of the screen's height, or upright of its width."""
FAR_SPARE_ARC_MIN: Final = 0.1
"""So much larger than needed is it made."""
CAP_RATIO: Final = 0.668
"""Cap height of the font in parts of its size."""
TEXT_MAX_RATIO: Final = 1.1
NARROW_RATIO: Final = 9 / math.hypot(16, 9)
"""Shorter side of the longest screen for which the page is made, in parts of its diagonal."""
HELP_MAX: Final = 34
UNSTRAP_MAX: Final = 64
"""Characters that fit on the page beside all else, at that size."""


class Help(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to call for help, in both languages."""

    en: Annotated[str, Meta(min_length=1, max_length=HELP_MAX)]
    """English; a telephone number, for example."""
    de: Annotated[str, Meta(min_length=1, max_length=HELP_MAX)]
    """German."""


class Unstrap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to get out of the straps, in both languages."""

    en: Annotated[str, Meta(min_length=1, max_length=UNSTRAP_MAX)]
    """English; as the maker of the machine says."""
    de: Annotated[str, Meta(min_length=1, max_length=UNSTRAP_MAX)]
    """German."""


class Web(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the pages are served."""

    host: Annotated[str, Meta(min_length=1)]
    """Address to bind: 127.0.0.1, another one, or 0.0.0.0."""
    port: Annotated[int, Meta(ge=0, le=65535)]
    """Port of the pages; each server has its own."""
    certificate: Path | None = None
    """PEM file; mandatory with another address than loopback."""
    key: Path | None = None
    """PEM file of the certificate's private key; given with `certificate`, or not at all."""
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
    """TRAINER in the keys; None: that of the credentials, or `trainer`."""

    def read_credentials(self) -> Credentials | None:
        """Read the folder; None without keys."""
        return None if self.credentials is None else read_credentials(self.credentials)


Side = Literal["right", "left"]


class ShownLeg(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A leg on the page."""

    name: Side
    """Side of the leg, as in the trainer file."""
    glow_full_w: Annotated[float, Meta(ge=0.1, le=500)]
    """Power of the patient, with the motion, at which the leg glows fully; it is no target."""


class Target(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The target of each step where another program starts the gait."""

    share_low_ratio: Annotated[float, Meta(ge=0, le=1)]
    """Lower end, as `Stride.share_ratio`."""
    share_high_ratio: Annotated[float, Meta(ge=0, le=1)]
    """Upper end; above the lower one."""


class Screen(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The screen that the page fills, and from where it is read."""

    diagonal_in: Annotated[float, Meta(ge=5, le=100)] = 10.0
    """Diagonal of the screen, from its data sheet. A smaller screen than this makes text
    unreadable from the chair."""
    distance_m: Annotated[float, Meta(ge=0.3, le=10)] = 1.5
    """From the eyes of the person in the machine to the screen; measure it."""

    @property
    def diagonal_mm(self) -> float:
        """Diagonal of the screen."""
        return self.diagonal_in * MM_PER_IN

    @property
    def far_mm(self) -> float:
        """Least size of text that has to be read from the chair."""
        arc_rad = math.radians((FAR_ARC_MIN + FAR_SPARE_ARC_MIN) / 60)
        return 1e3 * self.distance_m * math.tan(arc_rad) / CAP_RATIO

    def arc_min(self, text_ratio: float) -> float:
        """Return the cap height of the smallest text, in minutes of arc, on the longest screen."""
        cap_mm = FAR_RATIO * CAP_RATIO * NARROW_RATIO * self.diagonal_mm * text_ratio
        return math.degrees(math.atan(cap_mm / (1e3 * self.distance_m))) * 60


Language = Literal["en", "de"]


class Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the pages say."""

    language: Language
    """At start; a button on the page changes it."""
    switch_hand: Side = "right"
    """The hand that holds the hand switch; buttons lie on the side of the other one."""
    help: Help
    """How to call for help, for example a telephone number."""
    unstrap: Unstrap
    """How to get out of the straps of this machine."""


class HipDrift(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How far a hip without a brake may drift on the way out."""

    drift_max_deg: Annotated[float, Meta(ge=0, le=10)]
    """A decision about this person: how far the hip may move without power while the page leads
    out. 0: only with a brake."""


class SlideDrift(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How far a slide without a brake may drift on the way out."""

    drift_max_m: Annotated[float, Meta(ge=0, le=0.1)]
    """A decision about this person: how far the slide may move without power while the page
    leads out. 0: only with a brake."""


class WayOutRules(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a leg without power moves so little that the patient may release it alone."""

    check: Path
    """Output of `gaitd check --json` for the configuration of the running service."""
    hip: HipDrift
    slide: SlideDrift


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
    screen: Screen = Screen()
    leg: Annotated[tuple[ShownLeg, ...], Meta(min_length=1, max_length=2)]
    target: Target | None = None
    """None: that of the session; without one the steps are not judged."""
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
    """Language of the page at start; a button on the page changes it."""
    legs: Annotated[tuple[Side, ...], Meta(min_length=1, max_length=2)]
    """Legs that are shown, as in the trainer file."""
    session: SessionFiles | None = None
    """None: the page shows no profile and no progress."""


class EngineerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file of the engineer's server."""

    web: Web
    trainer: Link
    truth: Path | None = None
    """File of `gaitd sim --truth`; None: the drives are real, and there is no truth."""
    pages: Path | None = None
    """Folder of further pages, served as /pages/; None: there are none."""


File = TypeVar("File", PatientSettings, TherapistSettings, EngineerSettings)


def read_settings(path: Path, kind: type[File]) -> File:
    """Read a file; relative paths in it are relative to its folder.

    Raises:
        ConfigError: it cannot be read, a key is wrong, or TLS is missing beyond loopback.
    """
    settings = load_toml(path, kind)
    if errors := [ConfigError(path, *one) for one in _contradictions(settings)]:
        raise ConfigError.combined(errors)
    return settings


def _contradictions(
    settings: PatientSettings | TherapistSettings | EngineerSettings,
) -> Iterator[tuple[str, object, str]]:
    """Values that are allowed alone, and not together: key, value, what is allowed."""
    web = settings.web
    yield from _of_web(web)
    if not isinstance(settings, EngineerSettings):
        session = settings.session
        if session is not None and _is_folder(session.history) is not False:
            allowed = "the name of a file; this is a folder, or cannot be looked up"
            yield "session.history", session.history, allowed
    elif not web.is_loopback:
        allowed = (
            "127.0.0.1, because this page shows a patient's data without login; reach it from"
            " another machine through a tunnel of SSH"
        )
        yield "web.host", web.host, allowed
    elif settings.pages is not None and not _is_folder(settings.pages):
        yield "pages", settings.pages, "a folder that exists"
    if isinstance(settings, PatientSettings):
        yield from _of_patient(settings)


def _is_folder(path: Path) -> bool | None:
    """True if there is this folder; None if it cannot be looked up, as its name is too long."""
    try:
        return path.is_dir()
    except OSError:
        return None


def _of_web(web: Web) -> Iterator[tuple[str, object, str]]:
    if (web.certificate is None) != (web.key is None):
        name, value = ("key", web.certificate) if web.key is None else ("certificate", web.key)
        yield f"web.{name}", MISSING, f"web.certificate and web.key together; the other is {value}"
    elif not web.is_loopback and web.certificate is None:
        allowed = "127.0.0.1, or web.certificate and web.key, as other machines can reach it"
        yield "web.host", web.host, allowed
    elif not web.is_loopback and not (
        web.origins and all(origin.startswith("https://") for origin in web.origins)
    ):
        allowed = "the addresses of the pages, such as https://trainer.lan:8443"
        yield "web.origins", list(web.origins), f"{allowed}, with web.host = {web.host}"


def _of_patient(settings: PatientSettings) -> Iterator[tuple[str, object, str]]:
    names = [leg.name for leg in settings.leg]
    target, screen = settings.target, settings.screen
    if len(set(names)) != len(names):
        yield "leg.name", names, "each leg once"
    if target is not None and settings.session is not None:
        yield "target", PlainText("(with [session])"), "one of both; a session has its own target"
    elif target is not None and not target.share_low_ratio < target.share_high_ratio:
        allowed = f"> target.share_low_ratio = {target.share_low_ratio:g}"
        yield "target.share_high_ratio", target.share_high_ratio, allowed
    if settings.session is not None and not settings.web.is_loopback:
        allowed = (
            "127.0.0.1 with [session]: a page without login may start a training on the machine's"
            " own screen only"
        )
        yield "web.host", settings.web.host, allowed
    arc_min = screen.arc_min(TEXT_MAX_RATIO)
    if arc_min < FAR_ARC_MIN:
        ratio = arc_min / FAR_ARC_MIN
        allowed = (
            f"{FAR_ARC_MIN:g} minutes of arc for the text, which would have {arc_min:.1f}:"
            f" distance_m up to {math.floor(100 * ratio * screen.distance_m) / 100:g}, or"
            f" diagonal_in from {math.ceil(10 * screen.diagonal_in / ratio) / 10:g}"
        )
        yield "screen.diagonal_in", screen.diagonal_in, allowed


def refuse_certificate(path: Path, web: Web) -> None:
    """Refuse a certificate of the file `path` with which no server can start.

    Raises:
        ConfigError: certificate or key cannot be read, or they do not belong together.
    """
    if web.certificate is None:
        return
    try:
        ssl.create_default_context().load_cert_chain(web.certificate, web.key, password="")
    except OSError as error:  # also of OpenSSL
        allowed = (
            f"PEM files of a certificate and of its key web.key = {web.key}, without a password"
            f" ({error.strerror})"
        )
        raise ConfigError(path, "web.certificate", web.certificate, allowed) from error
