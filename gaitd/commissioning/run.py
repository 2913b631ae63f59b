"""Plays the procedure: hands what is received to `step`, and its outputs to whom they concern."""

import sys
from typing import Protocol

import typer
from gaitd_client import ClientError, Reply, wire

from analysis.acceptance.record import (
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    StopTrace,
)
from analysis.acceptance.words import sentence
from gaitd.commissioning.messages import (
    EXPECTED,
    Answer,
    Expects,
    Instruction,
    Observation,
    ReadObjects,
    Request,
)
from gaitd.commissioning.procedure import BEGIN, State, Task, interrupted, is_over, step
from gaitd.language import texts
from gaitd.remote import complete


class Operator:
    """The person at the terminal, with instructions on stderr; with `agreed` nothing is asked."""

    def __init__(self, *, agreed: bool, witnessed: bool) -> None:
        """`witnessed`: the operator watches, and will see each motion as it is described."""
        self._agreed, self._witnessed = agreed, witnessed
        self._noted = ""

    def note(self, progress: wire.Progress | None) -> None:
        """Show the service's progress."""
        text = texts().progress(progress)
        if text not in {"", self._noted}:
            print(f"  {text}", file=sys.stderr, flush=True)
        self._noted = text

    def follow(self, instruction: Instruction) -> Answer | None:
        """Show an instruction; the answer to one that waits for something."""
        code, subject, values, service, refusal = instruction
        said, expected = texts(), EXPECTED.get(code)
        key = f"instruction.{code}"
        text = complete(sentence(said, key, subject, values, service, refusal))
        if expected is Expects.SIGHT and self._witnessed:
            return Answer(True)
        if expected is None or (expected is Expects.CONSENT and self._agreed):
            print(text, file=sys.stderr, flush=True)
            return None if expected is None else Answer(True)
        if self._agreed:
            return Answer(None)
        if expected is Expects.NUMBER:
            return Answer(typer.prompt(text, default=0.0, type=float, err=True))
        if expected is not Expects.SIGHT:
            text += f"\n{said.text(f'ask.{expected}')}"
        return Answer(typer.confirm(text, err=True))


class Source(Protocol):
    """A running service and its bus; each may raise ClientError."""

    def request(self, request: Request) -> Reply:
        """Send a request and wait for its answer."""
        ...

    def read(self, wanted: ReadObjects) -> tuple[Finding, ...]:
        """What the objects of a drive hold."""
        ...

    def newest(self) -> Observation:
        """What has come until now."""
        ...

    def following(self) -> Observation:
        """Wait for what comes next."""
        ...


class Run:
    """One run of a procedure."""

    def __init__(
        self, tasks: tuple[Task, ...], source: Source, operator: Operator, state: State = BEGIN
    ) -> None:
        self.tasks, self.state = tasks, state
        self.findings: list[Finding] = []
        self.stops: list[StopTrace] = []
        self.reply: Reply | None = None
        """The newest one of the service."""
        self._source, self._operator = source, operator

    @property
    def why(self) -> Reason | None:
        """Why it was not done, or not with the result that is wanted; None if it was."""
        reasons = (self.state.blocked, *(one.reason for one in self.findings))
        return next((one for one in reasons if one is not None), None)

    @property
    def is_good(self) -> bool:
        """True if it was done, and all its findings have passed."""
        return {one.judgement for one in self.findings} == {Judgement.PASSED} and self.why is None

    def has_passed(self, code: FindingCode) -> bool:
        """True if this finding was made, and has passed."""
        passed = (one.code for one in self.findings if one.judgement is Judgement.PASSED)
        return code in passed

    def play(self) -> None:
        """Do all tasks.

        Raises:
            ClientError: the service does not answer.
        """
        seen = self._source.newest()
        while not is_over(self.tasks, self.state):
            self.state, outputs = step(self.tasks, self.state, seen)
            reply = answer = None
            objects: tuple[Finding, ...] = ()
            for output in outputs:
                match output:
                    case Finding():
                        self.findings.append(output)
                    case StopTrace():
                        self.stops.append(output)
                    case Instruction():
                        answer = self._operator.follow(output)
                    case Request():
                        self.reply = reply = self._source.request(output)
                    case ReadObjects():
                        objects = self._source.read(output)
            seen = self._source.newest() if outputs else self._source.following()
            self._operator.note(seen.progress)
            seen = seen._replace(reply=reply, answer=answer, objects=objects)

    def play_to_rest(self) -> None:
        """Do all tasks; the last one also if an exception ends the others, for instance Ctrl-C.

        What was measured before is kept.

        Raises:
            ClientError: the service does not answer.
        """
        why = Reason(ReasonCode.INTERRUPTED)
        try:
            self.play()
        except ClientError as error:
            why = Reason(ReasonCode.INTERRUPTED, values={"said": str(error)})
            raise
        finally:
            if not is_over(self.tasks, self.state):
                self.state, found = interrupted(self.tasks, self.state, why)
                self.findings += found
                self.play()
