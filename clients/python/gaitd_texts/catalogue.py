"""One catalogue for each reader and language: sentences from codes and values.

A key is a group and a member, `event.homed`; the files say how texts are written. No function here
raises or returns an empty text for an unknown code: the patient then gets the most cautious
sentence, the operator the code with its values. A catalogue that cannot be read is one without
texts; the log has the reason.
"""

import logging
import math
import re
import string
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum, auto
from functools import cache
from pathlib import Path
from typing import Any, Final, Protocol

import msgspec
from gaitd_names import NMT_STATES, POWER_STATES, Cause
from gaitd_names.joints import JOINTS

from gaitd_texts.stops import GoOn, Situation, key_of, stop_of

LANGUAGES: Final = ("en", "de")
"""Languages of every text: English and German."""
FOLDER: Final = Path(__file__).parent
CAUTIOUS: Final = {
    "en": "Press the emergency stop. Call for help.",
    "de": "Not-Halt drücken. Hilfe rufen.",
}
"""What the patient reads where nothing is known."""
COMMANDS: Final = {
    "reset": "`gaitd reset`",
    "enable": "`gaitd enable`",
    "hand_guiding": "`gaitd mode hand_guiding`",
    "scan": " (`gaitd scan`)",
    "doctor": " (`gaitd doctor`)",
    "reference": " (`gaitd reference AXIS`)",
    "commission": " (`gaitd commission AXIS`)",
}
"""What a remedy names for a reader with a command line; a page has `button` for it, or nothing."""
LABEL: Final = "label"
"""Group of the labels of pages, which name them without it."""
_GROUP_OF: Final = {
    **{"mode_before": "mode", "mode_now": "mode", "open_request": "request"},
    **{"cause": "stopped", "cause_wanted": "stopped"},
}
"""Groups of values that are not called as their enum."""
_DERIVED: Final = frozenset({"axis", "motion", "unit", "unit_position"})
"""Fields that follow from the subject."""
_LOG: Final = logging.getLogger("gaitd.texts")

Value = float | str | None


class Verdict(Protocol):
    """A verdict of a message or of a record."""

    @property
    def cause(self) -> str:
        """Name of the cause."""
        ...

    @property
    def drive(self) -> str | None:
        """The drive or leg of the cause; empty or None if of none."""
        ...

    @property
    def value(self) -> float | None:
        """What was measured, in the unit of the limit."""
        ...

    @property
    def limit(self) -> float | None:
        """The limit; 0 or None if there is none."""
        ...

    @property
    def finding(self) -> str:
        """What it was found by, or none."""
        ...

    @property
    def said(self) -> str:
        """What the drive or the operating system has said."""
        ...


class Progress(Protocol):
    """Code, subject and values by name, as a message has them."""

    @property
    def code(self) -> str:
        """Its text is that of this code."""
        ...

    @property
    def subject(self) -> str | None:
        """Drive or leg; empty or None if of none."""
        ...

    @property
    def values(self) -> Mapping[str, Value]:
        """Numbers and names that the text has as fields."""
        ...


class Refusal(Progress, Protocol):
    """A refusal of a message."""

    @property
    def said(self) -> str:
        """What a client has sent, or a drive has said."""
        ...


class Event(Refusal, Protocol):
    """An event of a message."""

    @property
    def cause(self) -> str | None:
        """Cause of the stop that it reports."""
        ...


@dataclass(frozen=True)
class _Verdict:
    """A verdict from the values of an event or a refusal."""

    cause: str
    drive: str | None
    value: float | None
    limit: float | None
    finding: str
    said: str


class Reader(StrEnum):
    """Who reads; each has a file for each language."""

    OPERATOR = auto()
    PATIENT = auto()


@dataclass(frozen=True)
class Catalogue:
    """Texts for one reader in one language."""

    reader: Reader
    language: str
    texts: Mapping[str, str]
    """By key; empty if the file cannot be read."""

    def text(self, key: str, /, **fields: Value) -> str:
        """Return the text of a key with its fields filled in, or what stands for it."""
        template = self.texts.get(key)
        if template is not None:
            try:
                return self._filled(template, fields)
            except (ValueError, TypeError, OverflowError, OSError):
                # A value of another type or size than its text expects.
                _LOG.exception("text %s cannot be filled with %s", key, fields)
        return self._otherwise(key, fields)

    def has(self, key: str) -> bool:
        """Return whether there is a text; where none is needed an optional one may be left out."""
        return key in self.texts

    def subject(self, subject: str | None) -> str:
        """Return leg and axis in words; the name itself if it is of another machine."""
        leg, _, axis = (subject or "").partition("/")
        words = [
            self.texts.get(f"{group}.{name}")
            for group, name in (("side", leg), ("axis", axis))
            if name
        ]
        return ", ".join(word for word in words if word) if all(words) else subject or ""

    def interruption(self, code: str) -> str:
        """Return why a session left its course: a cause, a phase, a failure, or a refusal."""
        for key in (f"stopped.{code}", f"interruption.{code}", f"failure.{code}"):
            if self.has(key):
                return self.text(key)
        return self._refusal(code, None, {}, "")

    def event(self, event: Event) -> str:
        """Return the sentence of an event, with its subject before it."""
        return self.report(event.code, event.subject, event.values, event.said)

    def report(self, code: str, subject: str | None, values: Mapping[str, Value], said: str) -> str:
        """Return the sentence of an event that has no message yet."""
        key = f"event.{code}"
        template = self.texts.get(key, "{subject}")
        about = "" if _names_subject(template) else self.subject(subject)
        fields = self._about(subject, {**values, "said": said})
        if "{verdict}" in template:
            fields["verdict"] = self._verdict_of(subject, values, said)
        if "{refusal}" in template:
            refused = values.get("refusal")
            known = refused is not None
            fields["refusal"] = self._refusal(str(refused), subject, values, said) if known else ""
        if values.get("request", "mode") != "mode":
            fields["mode"] = None  # a mode belongs to its own request alone
        text = _tidy(self.text(key, **fields))
        return f"{about}: {text}" if about else text

    def event_remedy(self, event: Event, buttons: Mapping[str, str] = COMMANDS) -> str:
        """Return what a person can do after an event; empty where nothing has to be done."""
        if event.cause is not None:
            return self.remedy(event.cause, buttons)
        refused = event.values.get("setpoint_refusal")
        key = f"remedy.{event.code if refused is None else refused}"
        return self.text(key) if self.has(key) else ""

    def refusal(self, refusal: Refusal) -> str:
        """Return the sentence of a refusal."""
        return self._refusal(refusal.code, refusal.subject, refusal.values, refusal.said)

    def _refusal(
        self, code: str, subject: str | None, values: Mapping[str, Value], said: str
    ) -> str:
        key = f"refusal.{code}"
        fields: dict[str, Value] = {**values, "said": said}
        if "{verdict}" in self.texts.get(key, ""):
            fields["verdict"] = self._verdict_of(subject, values, said)
        return self.about(key, subject, fields)

    def progress(self, progress: Progress | None) -> str:
        """Return what the machine does now; empty if there is nothing beside mode and stage."""
        if progress is None:
            return ""
        return self.about(f"progress.{progress.code}", progress.subject, progress.values)

    def about(self, key: str, subject: str | None, values: Mapping[str, Value]) -> str:
        """Return the text of a key, with name, units and motion of a leg or an axis as fields."""
        return _tidy(self.text(key, **self._about(subject, values)))

    def verdict(self, verdict: Verdict) -> str:
        """Return the sentence of a verdict: drive, cause, value with limit, and what was found."""
        about = self.subject(verdict.drive)
        numbers = {"value": verdict.value, "limit": verdict.limit}
        parts = [
            self.text(f"stopped.{key_of(verdict.cause)}", cause=verdict.cause),
            self.text("verdict.numbers", **numbers) if verdict.limit else "",
        ]
        found = " ".join(part for part in (self._finding(verdict), verdict.said) if part)
        text = " ".join(part for part in parts if part) + (f": {found}" if found else "")
        return f"{about}: {text}" if about else text

    def remedy(
        self,
        cause: str,
        buttons: Mapping[str, str] = COMMANDS,
        situation: Situation | None = None,
    ) -> str:
        """Return what a person can do after a stop, in the order of doing; empty without a stop.

        Args:
            cause: of the stop.
            buttons: what to press for `reset`, `enable` and `hand_guiding`.
            situation: of the leg now; None: that of the cause.
        """
        if cause == Cause.NONE:
            return ""
        stop = stop_of(cause)
        return " ".join(
            (
                self.text(f"first.{situation or stop.situation}"),
                self.then(cause, buttons),
                self.text("label.if_again"),
                self.text(f"again.{stop.again}"),
            )
        )

    def then(self, cause: str, buttons: Mapping[str, str] = COMMANDS) -> str:
        """Return how to continue after a stop."""
        stop = stop_of(cause)
        go_on, step = stop.go_on, f"stop_step.{stop.step_of or key_of(cause)}"
        keys = [step] if self.has(step) or go_on is GoOn.ONLY else []
        keys += [] if go_on is GoOn.ONLY else [f"go_on.{go_on}"]
        texts = [self.text(key, **buttons) for key in keys]
        return " ".join(text[:1].upper() + text[1:] for text in texts)

    def buttons(self) -> dict[str, str]:
        """Return what a page calls the buttons that a remedy names."""
        return {name: self.texts.get(f"button.{name}", "") for name in COMMANDS}

    def _filled(self, template: str, fields: Mapping[str, Value]) -> str:
        shown = {name: self._shown(name, value) for name, value in fields.items()}
        return _FORMATTERS[self.language].vformat(template, (), shown)

    def _shown(self, name: str, value: Value) -> Value:
        if not isinstance(value, str):
            return value
        return self.texts.get(f"{_GROUP_OF.get(name, name)}.{value}", value)

    def _otherwise(self, key: str, fields: Mapping[str, Value]) -> str:
        if self.reader is Reader.PATIENT:
            return CAUTIOUS[self.language]
        told = [
            f"{name}={value}"
            for name, value in fields.items()
            if value not in {None, ""} and name not in _DERIVED
        ]
        return " ".join((key.partition(".")[2], *told))

    def _about(self, subject: str | None, values: Mapping[str, Value]) -> dict[str, Value]:
        name = (subject or "").partition("/")[2]
        joint = JOINTS.get(name)
        return {
            **values,
            "motion": name,
            "subject": self.subject(subject),
            "axis": subject or "",
            "unit": joint.effort if joint else "",
            "unit_position": joint.position if joint else "",
        }

    def _verdict_of(self, drive: str | None, values: Mapping[str, Value], said: str) -> str:
        return self.verdict(
            _Verdict(
                cause=str(values.get("cause")),
                drive=drive,
                value=_number(values.get("value")),
                limit=_number(values.get("limit")),
                finding=str(values.get("finding", "none")),
                said=said,
            )
        )

    def _finding(self, verdict: Verdict) -> str:
        value = verdict.value
        number = round(value) if value is not None and math.isfinite(value) else 0
        fields: dict[str, Value] = {
            "value": value,
            "nmt_state": NMT_STATES.get(number, str(number)),
            "power_state": dict(enumerate(POWER_STATES)).get(number, str(number)),
            "emcy_code": number,
        }
        return self.text(f"finding.{verdict.finding}", **fields)


@cache
def catalogue(reader: Reader, language: str) -> Catalogue:
    """Return the texts for a reader; English for a language that there is none of."""
    known = language if language in LANGUAGES else LANGUAGES[0]
    return Catalogue(reader, known, read(FOLDER / f"{reader}.{known}.toml"))


def read(file: Path) -> dict[str, str]:
    """Read a catalogue; empty if it cannot be read, with the reason in the log."""
    try:
        told = tomllib.loads(file.read_text(encoding="utf-8"))
        groups = msgspec.convert(told, dict[str, dict[str, str]])
    except (OSError, ValueError, msgspec.ValidationError) as error:
        _LOG.error("%s: the texts cannot be read: %s", file, error)
        return {}
    return {
        f"{group}.{member}": text
        for group, members in groups.items()
        for member, text in members.items()
    }


def texts_of(language: str, readers: Sequence[Reader]) -> dict[str, str]:
    """Return all texts of several readers by the keys that a page names: labels without group."""
    return {
        key.removeprefix(f"{LABEL}."): text
        for reader in readers
        for key, text in catalogue(reader, language).texts.items()
    }


def language_of(environment: Mapping[str, str]) -> str:
    """Return the first language of LANGUAGE, LC_ALL, LC_MESSAGES or LANG that there are texts in.

    As gettext: LANGUAGE, a list, counts only where the locale is not C. English if there is none.
    """
    names = ("LC_ALL", "LC_MESSAGES", "LANG")
    locale = next((environment[name] for name in names if environment.get(name)), "C")
    if locale.partition(".")[0] in {"C", "POSIX"}:
        return LANGUAGES[0]
    wanted = [*environment.get("LANGUAGE", "").split(":"), locale]
    languages = (name.partition("_")[0].partition(".")[0] for name in wanted)
    return next((one for one in languages if one in LANGUAGES), LANGUAGES[0])


class _Formatter(string.Formatter):
    """Numbers as the language writes them; `–` for a number that is not known, else nothing."""

    def __init__(self, decimal_mark: str, percent: str) -> None:
        self._marks = str.maketrans({".": decimal_mark, "%": percent})

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:  # noqa: ANN401, ARG002 - its base says so
        return kwargs.get(str(key))

    def format_field(self, value: Any, format_spec: str) -> str:  # noqa: ANN401 - as its base
        if value is None:
            return "–" if format_spec else ""
        if format_spec == "time":
            return _time(value)
        if format_spec.endswith("X"):
            value = round(value)
        text = format(value, format_spec)
        return text.translate(self._marks) if isinstance(value, float) else text


_FORMATTERS: Final = {"en": _Formatter(".", "%"), "de": _Formatter(",", "\u00a0%")}


def _time(utc_s: float) -> str:
    """Return a time in UTC; 0: it is not known."""
    return f"{datetime.fromtimestamp(utc_s, UTC):%Y-%m-%d %H:%M:%S} UTC" if utc_s else "–"


def _number(value: Value) -> float | None:
    return value if isinstance(value, float | int) else None


def _names_subject(template: str) -> bool:
    """Return whether a sentence has its subject in it: a verdict names its drive."""
    return "{subject}" in template or "{verdict}" in template or "{refusal}" in template


def _tidy(text: str) -> str:
    """Return a sentence without the marks about a field that is empty."""
    text = re.sub(r" ?\(\)", "", text)
    return re.sub(r" +([:.,])(?=\s|$)", r"\1", re.sub(r" {2,}", " ", text)).strip(" :")
