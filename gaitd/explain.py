"""`gaitd explain NAME`: a cause, a refusal or an event in sentences; needs no running service.

The sentences are those of `gaitd status`, of a refused request and of the events. Only which keys
of limits.toml decide whether a cause is found stands here: `daemon/core/safety/checks.py` reads
them converted.
"""

import string
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import typer
from gaitd_names import Cause, EventCode, RefusalCode, SetpointRefusal
from gaitd_texts import STOPS, Catalogue
from gaitd_toml import COMMAND_LINE, ConfigError, load_toml

from daemon.config.limit_settings import Limits
from daemon.wire.causes import CHOSEN_CATEGORY, FIXED_CATEGORY
from gaitd.command_line import JsonOption, json_text
from gaitd.language import texts
from gaitd.remote import ConfigOption, complete

POSITIONS: Final = (
    *("hip.position_min_deg", "hip.position_max_deg"),
    *("slide.position_min_m", "slide.position_max_m"),
)
MISMATCHES: Final = (
    *("hip.sign_mismatch_torque_min_nm", "slide.sign_mismatch_force_min_n"),
    *("hip.patient_torque_max_nm", "slide.patient_force_max_n", "watch.sign_mismatch_cycles"),
)
DECIDING: Final[Mapping[Cause, tuple[str, ...]]] = {
    Cause.GATEWAY_SILENT: ("communication.gateway_silence_ms",),
    Cause.CYCLE_OVERRUN: ("communication.overruns_in_a_row",),
    Cause.DRIVE_SILENT: ("communication.sample_age_max_cycles",),
    Cause.HEARTBEAT_LOST: ("communication.heartbeat_timeout_ms",),
    Cause.MODE_NOT_SHOWN: ("communication.mode_switch_cycles",),
    Cause.NOT_FOLLOWING: (
        *("communication.mode_switch_cycles", "hip.hold_distance_max_deg"),
        "slide.hold_distance_max_m",
    ),
    Cause.ENCODER_FROZEN: ("communication.encoder_frozen_cycles",),
    Cause.ENCODER_JUMP: ("communication.encoder_jump_ratio",),
    Cause.SIGN_WRONG: MISMATCHES,
    Cause.MOVED_AGAINST_DRIVE: MISMATCHES,
    Cause.EFFORT_DEVIATION: (
        *("hip.torque_deviation_max_nm", "slide.force_deviation_max_n", "watch.deviation_cycles"),
        *("hip.load_deviation_max_nm", "slide.load_deviation_max_n"),
    ),
    Cause.POSITION_LIMIT: POSITIONS,
    Cause.VELOCITY_LIMIT: ("hip.velocity_max_rad_per_s", "slide.velocity_max_m_per_s"),
    Cause.EFFORT_LIMIT: ("hip.torque_max_nm", "slide.force_max_n"),
    Cause.POWER_LIMIT: ("hip.power_max_w", "slide.power_max_w"),
    Cause.TRACKING_LIMIT: (
        *("hip.tracking_max_deg", "slide.tracking_max_m"),
        *("hip.hold_distance_max_deg", "slide.hold_distance_max_m"),
    ),
    Cause.TEMPERATURE_LIMIT: ("hip.temperature_max_degc", "slide.temperature_max_degc"),
    Cause.SINGULARITY: ("singularity.stop_ratio",),
    Cause.LIMIT_SWITCH: ("stop.hip.standstill_rad_per_s", "stop.slide.standstill_m_per_s"),
    Cause.ENERGY_LIMIT: (
        "hip.stride_energy_max_j",
        "slide.stride_energy_max_j",
        "watch.energy_window_ms",
    ),
    Cause.STOPPING_PATH: (*POSITIONS, "singularity.stop_ratio"),
    Cause.STATIC_LOAD_WRONG: ("hip.static_load_tolerance_nm", "slide.static_load_tolerance_n"),
    Cause.SPASM: ("spasm.hip.rise_nm", "spasm.slide.rise_n", "spasm.patience_ms"),
    Cause.CLONUS: ("clonus.hip.swing_nm", "clonus.slide.swing_n", "clonus.patience_ms"),
    Cause.STOP_NOT_OBEYED: ("stop.obey_cycles", "stop.standstill_cycles", "stop.ramp_margin_ratio"),
}
"""Keys of limits.toml by which a cause is found; one that is not here is found without a number."""

GROUPS: Final = {"cause": "stopped", "refusal": "refusal", "setpoint_refusal": "setpoint_refusal"}
"""Group of the sentences of each kind of name; that of an event is `event`."""


class Answer(NamedTuple):
    """What is known of a name; only a cause has what is below `remedy`."""

    name: str
    kind: str
    text: str
    remedy: str
    category: str | None = None
    """Category of the stop; None without a file of limits that chooses it."""
    situation: str | None = None
    if_again: str | None = None
    limits: dict[str, float | str | None] = {}  # noqa: RUF012 - never changed
    """Values by key; None without a file of limits."""


def _names() -> list[str]:
    return list(dict.fromkeys(name for names in _by_kind(texts()).values() for name in names))


def command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="of a cause, a refusal or an event, such as hand_switch_open; without it all are"
            " listed",
            autocompletion=_names,
        ),
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Explain a stop, a refusal or an event: what it means, and what to do.

    With --config the limits of that trainer are shown, too.
    """
    said, limits = texts(), _limits(config)
    wanted = None if name is None else name.lower()
    answers = [
        _answer(said, kind, one, limits)
        for kind, names in _by_kind(said).items()
        for one in names
        if wanted in {None, one}
    ]
    if not answers:
        near = get_close_matches(wanted or "", _names()) or _names()
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of {', '.join(near)}")
    if as_json:
        print(json_text(answers))
    elif wanted is None:
        labels = (said.text(f"explain.{answer.kind}") for answer in answers)
        print(
            *(
                f"{label:<18} {one.name:<24} {one.text}"
                for label, one in zip(labels, answers, strict=True)
            ),
            sep="\n",
        )
    else:
        print("\n\n".join("\n".join(_screen(said, answer)) for answer in answers))


def _by_kind(said: Catalogue) -> dict[str, list[str]]:
    """Return the names of each kind; of the events those after which a person can do something."""
    return {
        "cause": [*map(str, STOPS)],
        "refusal": [*RefusalCode],
        "setpoint_refusal": [*SetpointRefusal],
        "event": [code for code in EventCode if said.has(f"remedy.{code}")],
    }


def _limits(config: Path | None) -> Limits | None:
    """Return the limits of a trainer file.

    Raises:
        ConfigError: one of the two files cannot be used.
    """
    if config is None:
        return None
    from daemon.config.trainer import load_trainer

    return load_toml(load_trainer(config).limits, Limits)


def _answer(said: Catalogue, kind: str, name: str, limits: Limits | None) -> Answer:
    text = _without_values(said, f"{GROUPS.get(kind, kind)}.{name}")
    if kind != "cause":
        key = f"{'next' if kind == 'refusal' else 'remedy'}.{name}"
        remedy = complete(_without_values(said, key)) if said.has(key) else ""
        return Answer(name, kind, text, remedy)
    cause, stop = Cause(name), STOPS[name]
    keys = DECIDING.get(cause, ())
    category: str | None = FIXED_CATEGORY.get(cause)
    if cause in CHOSEN_CATEGORY:
        keys = (*keys, f"stop_category.{cause}")
        category = None if limits is None else limits.stop_category[cause]
    return Answer(
        *(name, kind, text, complete(said.remedy(cause)), category),
        *(stop.situation, stop.again, {key: _value(limits, key) for key in keys}),
    )


def _without_values(said: Catalogue, key: str) -> str:
    """Return a text with names in capitals in place of names, and – in place of numbers."""
    fields = string.Formatter().parse(said.texts[key])
    return said.text(key, **{one: one.upper() for _, one, form, _ in fields if one and not form})


def _value(limits: Limits | None, key: str) -> Any:  # noqa: ANN401 - as the file has it
    def member(table: Any, name: str) -> Any:  # noqa: ANN401
        return table[name] if isinstance(table, dict) else getattr(table, name)

    return None if limits is None else reduce(member, key.split("."), limits)


def _screen(said: Catalogue, answer: Answer) -> Iterator[str]:
    """Format an answer, line by line."""
    label = " ".join(filter(None, (said.text(f"explain.{answer.kind}"), answer.category)))
    yield f"{label:<18} {answer.text}"
    if answer.remedy:
        yield f"{said.text('status.remedy'):<18} {answer.remedy}"
    label = said.text("explain.decided_by")
    for key, value in answer.limits.items():
        yield f"{label:<18} limits.toml: {key}" + ("" if value is None else f" = {value}")
        label = ""
