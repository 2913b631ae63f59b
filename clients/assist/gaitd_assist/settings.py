"""Settings of the controller: one strict TOML file. Every value is a decision, none has a default.

Caps, dead bands and the floor are decided by a therapist for a patient; docs/assist.md says what
each does. The table [transparency] may be left out: friction is then not fed forward.
"""

import math
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from gaitd_client import Configuration, PlanLimits
from gaitd_toml import ConfigError, decoded, load_toml, parse_toml
from msgspec import Meta

from gaitd_assist.law import Pair
from gaitd_assist.leg import LegController
from gaitd_assist.phase_help import HelpRules
from gaitd_assist.transparency import TransparencyRules

Ratio = Annotated[float, Meta(ge=0, le=1)]
CAPS: Final = (("hip", "max_nm", "assist_max_nm"), ("slide", "max_n", "assist_max_n"))
"""Axis, its key of `[cap]`, its key of limits.toml."""


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file: unknown and missing keys are refused."""


class Link(_Strict, frozen=True, kw_only=True):
    """The service; nothing of it has to be given."""

    endpoint: str | None = None
    """Zenoh endpoint; None: that of the credentials, or tcp/127.0.0.1:7447."""
    credentials: Path | None = None
    """Folder of `gaitd keys issue`; None: the service has no keys."""
    trainer: str | None = None
    """TRAINER in the keys; None: that of the credentials, or `trainer`."""


class HipCap(_Strict, frozen=True, kw_only=True):
    """The largest assist of the hip."""

    max_nm: Annotated[float, Meta(ge=0, le=120)]
    """Largest assist. At most that of `limits.toml` and of the released plan; a larger one is
    refused at the start."""


class SlideCap(_Strict, frozen=True, kw_only=True):
    """The largest assist of the slide."""

    max_n: Annotated[float, Meta(ge=0, le=1500)]
    """Largest assist. At most that of `limits.toml` and of the released plan; a larger one is
    refused at the start."""


class Cap(_Strict, frozen=True, kw_only=True):
    """The largest assist, of all laws together."""

    hip: HipCap
    slide: SlideCap


class HipBand(_Strict, frozen=True, kw_only=True):
    """The dead band of the hip."""

    width_deg: Annotated[float, Meta(ge=0.5, le=10)]
    """Distance from the reference that no law learns from. Narrower: more help, and less
    freedom for the patient."""


class SlideBand(_Strict, frozen=True, kw_only=True):
    """The dead band of the slide."""

    width_m: Annotated[float, Meta(ge=0.005, le=0.2)]
    """Distance from the reference that no law learns from. Narrower: more help, and less
    freedom for the patient."""


class DeadBand(_Strict, frozen=True, kw_only=True):
    """Errors within it are the patient's own: no law learns from them."""

    hip: HipBand
    slide: SlideBand


class HipHelp(_Strict, frozen=True, kw_only=True):
    """Assist of the hip by its error."""

    gain_nm_per_rad: Annotated[float, Meta(ge=0, le=1000)]
    """Assist that is learned in a stride for each radian beyond the dead band."""


class SlideHelp(_Strict, frozen=True, kw_only=True):
    """Assist of the slide by its error."""

    gain_n_per_m: Annotated[float, Meta(ge=0, le=20000)]
    """Assist that is learned in a stride for each metre beyond the dead band."""


class HelpTable(_Strict, frozen=True, kw_only=True):
    """Guidance and assist over the stride: `phase_help.py`."""

    law: Literal["estimate", "stray"]
    """What the assist is learned from."""
    forgetting_ratio: Annotated[float, Meta(ge=0.5, lt=1)]
    """Share of the assist that is kept from a stride to the next. Lower: help fades sooner, and
    a patient who needs it gets less."""
    release_ratio: Annotated[float, Meta(ge=0.3, lt=1)]
    """Share that is kept in a stride without an error; at most `forgetting_ratio`."""
    floor_ratio: Annotated[float, Meta(ge=0.05, lt=1)]
    """Least stiffness of guidance, as a ratio of the configured one. Lower: the leg strays
    farther."""
    stiffness_gain_ratio: Annotated[float, Meta(ge=0.01, le=2)]
    """Stiffness that a stride with an error of two dead bands gives back, of the configured."""
    hip: HipHelp
    slide: SlideHelp
    lead_s: Annotated[float, Meta(ge=0, le=0.5)]
    """How much earlier than its phase the assist is given, for the delay of drive and leg."""


class HipTransparency(_Strict, frozen=True, kw_only=True):
    """Friction fed forward at the hip."""

    friction_max_nm: Annotated[float, Meta(ge=0.01, le=60)]
    """Largest friction that is fed forward."""
    full_rad_per_s: Annotated[float, Meta(ge=0.05, le=2)]
    """Speed from which on it is fed forward in full; below it fades, because friction turns at
    rest."""
    tank_j: Annotated[float, Meta(ge=1e-3, le=1)]
    """Energy that the tank holds: the most that wrong friction can put into the leg."""


class SlideTransparency(_Strict, frozen=True, kw_only=True):
    """Friction fed forward at the slide."""

    friction_max_n: Annotated[float, Meta(ge=0.1, le=700)]
    """Largest friction that is fed forward."""
    full_m_per_s: Annotated[float, Meta(ge=0.02, le=1)]
    """Speed from which on it is fed forward in full; below it fades, because friction turns at
    rest."""
    tank_j: Annotated[float, Meta(ge=1e-3, le=5)]
    """Energy that the tank holds: the most that wrong friction can put into the leg."""


class TransparencyTable(_Strict, frozen=True, kw_only=True):
    """Friction fed forward: `transparency.py`."""

    feedforward_ratio: Annotated[float, Meta(ge=0.01, le=0.8)]
    """Share of the estimated friction that is fed forward. Towards 1 the leg could run by
    itself where friction is estimated too high."""
    friction_error_ratio: Annotated[float, Meta(ge=0.2, lt=1)]
    """What calibration may be wrong by: the tank counts what friction takes for certain."""
    hip: HipTransparency
    slide: SlideTransparency

    def rules(self) -> TransparencyRules:
        """Constants of the law."""
        return TransparencyRules(
            friction_max=(self.hip.friction_max_nm, self.slide.friction_max_n),
            full_speed=(self.hip.full_rad_per_s, self.slide.full_m_per_s),
            tank_j=(self.hip.tank_j, self.slide.tank_j),
            feedforward_ratio=self.feedforward_ratio,
            error_ratio=self.friction_error_ratio,
        )


class Settings(_Strict, frozen=True, kw_only=True):
    """The file."""

    legs: Annotated[tuple[Annotated[str, Meta(pattern="^(left|right)$")], ...], Meta(min_length=1)]
    """Legs that are assisted, as in the trainer file."""
    log: Path
    """JSON lines, one for each stride; appended to."""
    cadence_max_hz: Annotated[float, Meta(ge=0.01, le=2)]
    """Faster gaits are not assisted."""
    trainer: Link
    cap: Cap
    dead_band: DeadBand
    help: HelpTable
    transparency: TransparencyTable | None = None

    def controller(self, stiffness: Pair | None) -> LegController:
        """Make the controller of one leg.

        Args:
            stiffness: as of `stiffness_of`.
        """
        cap = self.cap.hip.max_nm, self.cap.slide.max_n
        help_ = self.help
        return LegController(
            HelpRules(
                dead_band=(
                    math.radians(self.dead_band.hip.width_deg),
                    self.dead_band.slide.width_m,
                ),
                cap=cap,
                forgetting_ratio=help_.forgetting_ratio,
                release_ratio=help_.release_ratio,
                stiffness_gain_ratio=help_.stiffness_gain_ratio,
                floor_ratio=help_.floor_ratio,
                gain=(help_.hip.gain_nm_per_rad, help_.slide.gain_n_per_m),
                lead_s=help_.lead_s,
                stiffness=stiffness,
            ),
            cap,
            self.cadence_max_hz,
            None if self.transparency is None else self.transparency.rules(),
        )


def stiffness_of(settings: Settings, path: Path, configuration: Configuration) -> Pair | None:
    """Return the stiffness of the service's guidance in full, N·m/rad and N/m.

    Args:
        settings: of the file `path`.
        path: names the file in errors.
        configuration: of the service.

    Returns: None if the law of the file does not ask for it.

    Raises:
        ConfigError: the law asks for it, and the service is too old to tell it.
    """
    if settings.help.law == "stray":
        return None
    guidance = configuration.guidance
    if not guidance:
        allowed = (
            f'"stray": version {configuration.version} of the service does not tell `guidance`'
        )
        raise ConfigError(path, "help.law", settings.help.law, allowed)
    return guidance["hip"]["stiffness_nm_per_rad"], guidance["slide"]["stiffness_n_per_m"]


def read_settings(path: Path) -> Settings:
    """Read a file; relative paths in it are relative to its folder.

    Raises:
        ConfigError: it cannot be read, or a key is missing, unknown or wrong.
    """
    return load_toml(path, Settings)


def parse_settings(text: str, path: Path) -> Settings:
    """Read a text as the file `path`.

    Raises:
        ConfigError: a key is missing, unknown or wrong.
    """
    return decoded(parse_toml(path, text.encode()), Settings)


def check_caps(
    settings: Settings, path: Path, configuration: Configuration, plan: PlanLimits | None
) -> None:
    """Compare the file with the service: legs, and assist that would be refused.

    Args:
        settings: of the file `path`.
        path: names the file in errors.
        configuration: of the service.
        plan: released now; None: none.

    Raises:
        ConfigError: a leg that the trainer does not have, or a cap above the limit of the service
            or of the plan.
    """
    known = configuration.leg_names
    if not set(settings.legs) <= set(known):
        raise ConfigError(path, "legs", list(settings.legs), f"the trainer has {list(known)}")
    for axis, key, limit_key in CAPS:
        value = getattr(getattr(settings.cap, axis), key)
        planned = None if plan is None else getattr(plan, axis).assist_max
        allowed = (
            (configuration.limits[axis][limit_key], "the service's limits"),
            (planned, "the released plan"),
        )
        for limit, source in allowed:
            if limit is not None and value > limit:
                allowed = f"at most {limit:g} ({axis}.{limit_key} of {source})"
                raise ConfigError(path, f"cap.{axis}.{key}", value, allowed)
