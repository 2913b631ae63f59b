"""A training: profile, pages and people of one session, and what its history says at the end."""

import json
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from daemon.config.edits import Edits
from gaitd_lab.demonstration.clients import HOST, address_of, patient_settings, shipped_settings
from gaitd_lab.demonstration.people import People
from gaitd_lab.demonstration.performance import Act, Playing
from gaitd_lab.demonstration.stage import OWN, Stage
from gaitd_lab.demonstration.training_script import training_act
from gaitd_lab.processes import ServiceError

if TYPE_CHECKING:
    from gaitd_session import Profile, SessionSummary

COMPLETE: Final = "complete"
ROLES: Final = {
    OWN: "display.demo",
    "engineer": "display.engineer",
    "patient": "session.patient",
    "therapist": "operator.therapist",
}
"""Clients of a training: its service has keys."""
EDITS: Final[Edits] = {
    "demo.toml": {"self_test.required": "daily", "gait.announce_s": 0.5, "gait.ramp_strides": 1}
}
"""The daily test as on a real trainer; a session of a minute has no time for long beginnings."""
SESSION: Final = """
[session]
profile = {profile}
history = {history}
"""
PROFILE: Final = {
    **{"version": 1, "hip_max": 10.0, "slide_max": 80.0, "share_min": 0.1, "share_max": 0.8},
    **{"cadence_min": 0.5, "cadence_max": 0.5, "amplitude_min": 0.5, "amplitude_max": 0.7},
    **{"warm_up": 6.0, "duration": 8.0, "rest": 2.0},
}
"""Values of the profile, as `gaitd-session new-profile` is given them; short blocks."""
BLOCK_COUNT: Final = 3
"""With the one that warms up."""


class BlockResult(NamedTuple):
    """Strides of a block, as the history has them."""

    stride_count: int
    shares: Sequence[float]
    """The patient's share of each stride for which it is known."""


class TrainingResult(NamedTuple):
    """A session as its history has it."""

    summary: "SessionSummary"
    blocks: Sequence[BlockResult]
    """Those of the plan."""

    @property
    def passed(self) -> bool:
        """Each block was walked with strides that are known, and nothing has interrupted it."""
        summary = self.summary
        are_known = all(block.shares for block in self.blocks)
        return summary.end == COMPLETE and summary.interruption_count == 0 and are_known


class Training:
    """The act of a training, and what became of it."""

    def __init__(self, patient_port: int, therapist_port: int, *, is_hands_on: bool) -> None:
        """Draw a password that is easy to type.

        Args:
            patient_port: of the patient's page.
            therapist_port: of the therapist's page.
            is_hands_on: a person presses the patient's buttons.
        """
        self._patient_port, self._therapist_port = patient_port, therapist_port
        self._hands_on = address_of(patient_port) if is_hands_on else ""
        self.password = "-".join(secrets.token_hex(2) for _ in range(3))
        """Password of the therapist's page."""
        self.result: TrainingResult | None = None
        """The session; None: none was begun."""

    @property
    def shown(self) -> str:
        """Addresses and password for the live view, short enough for 80 columns."""
        patient, therapist = (f"{HOST}:{one}" for one in (self._patient_port, self._therapist_port))
        return f"patient {patient}, therapist {therapist}, password {self.password}"

    def act(self) -> Act:
        """Return the act, with the configuration of its service."""
        return Act(self._play, EDITS, ROLES)

    def _play(self, playing: Playing) -> None:
        """Serve both pages, with a patient and a therapist; then read what it has been."""
        from gaitd_session.plan import limits_of

        where = playing.where
        file, history = where.folder / "profile.toml", where.folder / "history.sqlite"
        profile = profile_of(where.leg, file)
        session = SESSION.format(profile=json.dumps(str(file)), history=json.dumps(str(history)))
        where.start_client("patient", self._patient_settings(where) + session)
        where.start_client("therapist", self._therapist_settings(where) + session)
        ports, plan = (self._patient_port, self._therapist_port), limits_of(profile)
        try:
            with People(*ports, self.password, plan) as people:
                training_act(playing, people, BLOCK_COUNT, hands_on=self._hands_on)
        finally:
            where.end_clients()
            self.result = result_of(history, profile)

    def _patient_settings(self, where: Stage) -> str:
        return patient_settings(where, self._patient_port, where.credentials["patient"])

    def _therapist_settings(self, where: Stage) -> str:
        from gaitd_display.login import hash_password

        password_hash = hash_password(self.password)
        edits = {"web.port": self._therapist_port, "login.password_hash": password_hash}
        return shipped_settings("therapist", where, edits, where.credentials["therapist"])


def profile_of(leg: str, file: Path) -> "Profile":
    """Write the profile of a patient with a random id, and read it."""
    from gaitd_session.profile import new_id, read_profile
    from gaitd_session.program import BLOCK, TEMPLATE

    values = {**PROFILE, "id": new_id(), "legs": leg, "passive": ""}
    text = TEMPLATE.format_map(values) + BLOCK.format_map(values) * (BLOCK_COUNT - 1)
    file.write_text(text, encoding="utf-8")
    return read_profile(file)


def result_of(history: Path, profile: "Profile") -> TrainingResult | None:
    """Return the newest session of a history; None if none was begun.

    Raises:
        ServiceError: it cannot be read.
    """
    from gaitd_session.store import EXPORTED, Store, StoreError

    if not history.exists():
        return None
    try:
        with Store(history, is_writer=False) as store:
            summaries, rows = store.summaries(profile.id), store.strides(profile.id)
    except StoreError as error:
        raise ServiceError(f"the session's history: {error}") from error
    if not summaries:
        return None
    summary = summaries[-1]
    strides: list[dict[str, Any]] = [dict(zip(EXPORTED, row, strict=True)) for row in rows]
    strides = [stride for stride in strides if stride["session"] == summary.number]
    return TrainingResult(
        summary,
        [
            _block([stride for stride in strides if stride["block"] == number])
            for number in range(1, BLOCK_COUNT + 1)
        ],
    )


def _block(strides: Sequence[dict[str, Any]]) -> BlockResult:
    shares = [stride["share_ratio"] for stride in strides if stride["is_valid"]]
    return BlockResult(len(strides), shares)
