"""A training: profile, pages and people of one session, and what its history says at the end."""

import contextlib
import json
import secrets
import tomllib
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gaitd_lab.demonstration.pages import (
    HOST,
    address_of,
    page,
    patient_settings,
    shipped_settings,
    with_credentials,
)
from gaitd_lab.demonstration.people import PatientAtPage, People, TherapistAtPage
from gaitd_lab.demonstration.stage import Stage
from gaitd_lab.processes import ServiceError

if TYPE_CHECKING:
    from gaitd_session import Profile, SessionSummary

PASSWORD_PARTS: Final = 3
PASSWORD_PART_LENGTH: Final = 4
COMPLETE: Final = "complete"
SESSION: Final = """
[session]
profile = {profile}
history = {history}
"""
PROFILE: Final = """\
version = 1
id = "{id}"
legs = ["{leg}"]

[range]
cadence_min_hz = 0.3
cadence_max_hz = 0.5
amplitude_min_ratio = 0.4
amplitude_max_ratio = 0.8

[assist]
hip_max_nm = 10.0
slide_max_n = 80.0

[goal]
share_min_ratio = 0.1
share_max_ratio = 0.8
share_start_ratio = 0.2
band_width_ratio = 0.12
challenge_ratio = 0.02
step_max_ratio = 0.05
in_band_goal_ratio = 0.6

[plan.warm_up]
duration_s = 6.0
cadence_hz = 0.5
amplitude_ratio = 0.5
rest_s = 2.0

[[plan.block]]
duration_s = 8.0
cadence_hz = 0.5
amplitude_ratio = 0.6
rest_s = 2.0

[[plan.block]]
duration_s = 8.0
cadence_hz = 0.5
amplitude_ratio = 0.7
rest_s = 2.0
"""
BLOCK_COUNT: Final = 1 + len(tomllib.loads(PROFILE)["plan"]["block"])
"""With the one that warms up."""


class TrainingPlan(NamedTuple):
    """Where the pages of a training are, and who presses the patient's buttons."""

    patient_port: int
    therapist_port: int
    password: str
    """Password of the therapist's page."""
    is_hands_on: bool = False

    @property
    def shown(self) -> str:
        """Addresses and password for the live view, short enough for 80 columns."""
        patient, therapist = (f"{HOST}:{port}" for port in (self.patient_port, self.therapist_port))
        return f"patient {patient}, therapist {therapist}, password {self.password}"

    @property
    def hands_on(self) -> str:
        """Address of the patient's page, if a person presses its buttons; else empty."""
        return address_of(self.patient_port) if self.is_hands_on else ""


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


def new_password() -> str:
    """Draw a password that is easy to type: 31^12 are possible."""
    from gaitd_session.profile import ID_ALPHABET

    return "-".join(
        "".join(secrets.choice(ID_ALPHABET) for _ in range(PASSWORD_PART_LENGTH))
        for _ in range(PASSWORD_PARTS)
    )


class Training:
    """Files of one training in the folder of its act."""

    def __init__(self, where: Stage, plan: TrainingPlan) -> None:
        """Write the profile."""
        self._where, self._plan = where, plan
        self._file, self._history = where.folder / "profile.toml", where.folder / "history.sqlite"
        self.profile = profile_of(where.leg, self._file)

    @contextlib.contextmanager
    def people(self) -> Generator[People]:
        """Serve both pages inside the context, with a patient and a therapist."""
        from gaitd_session.plan import limits_of

        patient, therapist = self._plan.patient_port, self._plan.therapist_port
        plan = limits_of(self.profile)
        with (
            page("patient", self._where, self._patient_settings(patient)) as one,
            page("therapist", self._where, self._therapist_settings(therapist)) as other,
            PatientAtPage(patient) as looking,
            contextlib.closing(
                People((one, other), looking, TherapistAtPage(therapist, self._plan.password), plan)
            ) as people,
        ):
            yield people

    def _patient_settings(self, port: int) -> str:
        settings = patient_settings(self._where, port) + self._session()
        return with_credentials(settings, self._where.credentials["patient"])

    def _therapist_settings(self, port: int) -> str:
        from gaitd_display.login import hash_password

        edits = {"login.password_hash": hash_password(self._plan.password)}
        settings = shipped_settings("therapist", self._where, port, edits) + self._session()
        return with_credentials(settings, self._where.credentials["therapist"])

    def _session(self) -> str:
        profile, history = (json.dumps(str(path)) for path in (self._file, self._history))
        return SESSION.format(profile=profile, history=history)

    def result(self) -> TrainingResult | None:
        """Read the history, once the patient's page has ended; see `result_of`."""
        return result_of(self._history, self.profile)


def profile_of(leg: str, file: Path) -> "Profile":
    """Write the profile of a patient with a random id, and read it."""
    from gaitd_session.profile import new_id, read_profile

    file.write_text(PROFILE.format(id=new_id(), leg=leg), encoding="utf-8")
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
