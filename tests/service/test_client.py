"""The client library on a running service: each example as it is printed, and a lease that lasts.

One service for all, in simulated time: which estimate meets which setpoint is decided by the
computer, so nothing here counts them.
"""

import asyncio
import contextlib
import importlib.util
import threading
from pathlib import Path

import pytest
from gaitd_client import (
    Assist,
    AsyncTrainer,
    Mode,
    NoAnswerError,
    NoServiceError,
    NotValid,
    RequestRefusedError,
    SetpointRefusal,
    Trainer,
    Trouble,
)

from daemon.ipc import record

EXAMPLES = Path(__file__).parents[2] / "clients" / "python" / "examples"
PULL_NM = 3.0


def example(name):
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def assist_nm(service):
    newest = service.newest()
    return newest.legs[0].hip.assist if newest.mode == record.Mode.TORQUE else 0.0


@pytest.fixture
def trainer(long_service):
    """A client of the warm service, whose machine is ready."""
    long_service.bring(record.Mode.READY)
    with long_service.client() as made:
        yield made


def test_the_examples_of_all_roles_work_together(long_service, trainer, capsys):
    example("service").main(trainer)
    steering = threading.Thread(target=example("controller").main, args=(trainer, 2.0))
    steering.start()
    long_service.wait(lambda: trainer.status().safety.lease_holder is not None, 30)
    example("operator_role").main(trainer)
    long_service.wait(lambda: assist_nm(long_service) > 0.1, 30)
    long_service.wait(lambda: not steering.is_alive(), 60)
    long_service.wait(lambda: long_service.mode == record.Mode.HOLD, 30)
    steering.join()
    with long_service._fast():
        example("session").main(trainer, 1.0)

    async def display():
        target = trainer.target
        async with AsyncTrainer(target.endpoints, clock=trainer.clock) as shown:
            await example("display").main(shown, 20)

    asyncio.run(display())

    said = capsys.readouterr().out
    assert "right/hip: " in said
    assert "setpoints sent" in said
    assert "\ntorque\n" in said
    assert said.count("\nhold\n") == 1
    assert "hold: patient " in said
    trainer.events(history_count=0).close()  # Zenoh refuses a history of none
    asked_at = long_service.newest().cycle
    first = next(item for item in trainer.events() if not isinstance(item, NotValid))
    assert first.cycle < asked_at  # the history comes before anything new


def test_a_lease_says_why_setpoints_are_refused_and_outlives_the_gateway(long_service, trainer):
    pulls, calls, refusals = [float("nan")], [], []

    def law(estimate):
        calls.append(estimate.cycle)
        return Assist(pulls[0])

    def is_law_called_in_torque():
        long_service.wait(lambda: lease.is_held and not lease.why_not, 30)
        begun = trainer.mode(Mode.TORQUE).cycle
        long_service.wait(lambda: calls[-1] > begun or lease.why_not, 30)
        return calls[-1] > begun

    def steer():
        """Request torque; a law whose lease was just lost wants the mode to be left first."""
        while True:
            with contextlib.suppress(RequestRefusedError):  # the loss is not known here yet
                if is_law_called_in_torque():
                    return
                trainer.mode(Mode.HOLD)

    def refused_for(reason):
        return [refusal for refusal in refusals if refusal.reason == reason]

    trainer.enable()
    with trainer.lease("test", law, on_refusal=refusals.append) as lease:
        trainer.mode(Mode.TORQUE)
        long_service.wait(lambda: refusals, 30)
        assert refusals[0].reason == SetpointRefusal.NON_FINITE

        # The lapse after it has ended mode torque; a lease is kept in every mode that is no stop.
        pulls[0] = 1000.0
        long_service.wait(lambda: trainer.status().safety.mode == Mode.HOLD, 30)
        steer()
        # Others may follow it: those of the lapse, and of more setpoints than a fast clock allows.
        long_service.wait(lambda: refused_for(SetpointRefusal.OUT_OF_RANGE), 30)
        (first, *_) = refused_for(SetpointRefusal.OUT_OF_RANGE)
        assert "assist_max_nm" in first.meaning
        assert first.remedy

        # Not before the lapse: a good setpoint in time would prevent it.
        long_service.wait(lambda: trainer.status().safety.mode == Mode.HOLD, 30)
        pulls[0] = PULL_NM
        steer()
        long_service.wait(lambda: assist_nm(long_service) == PULL_NM, 30)

        estimates, safety = trainer.estimate("right"), trainer.safety()
        long_service.kill("gateway")
        silence = next(item for item in estimates if isinstance(item, NotValid))
        assert silence.trouble is Trouble.SILENT
        assert isinstance(estimates.newest(), NotValid)
        long_service.wait(lambda: isinstance(safety.newest(), NotValid) and not lease.is_held, 30)

        with (
            pytest.raises(NoServiceError, match="no service listens on"),
            Trainer.of(trainer.target),
        ):
            pass
        early = Trainer(trainer.target.endpoints, clock=trainer.clock, keep_trying=True)
        with early, early.activity("right") as activity:
            assert isinstance(activity.newest(), NotValid)
            with pytest.raises(NoAnswerError, match="not connected"):
                early.status()
            long_service.start_gateway()
            assert next(item for item in estimates if not isinstance(item, NotValid)).cycle
            assert next(item for item in activity if not isinstance(item, NotValid)).cycle
        assert lease.why_not
        long_service.reset()
        long_service.wait(lambda: lease.is_held, 30)
        assert trainer.status().safety.lease_holder == "test"
    assert trainer.status().safety.lease_holder is None


def test_an_exception_of_the_law_ends_the_assist_and_reaches_the_program(long_service, trainer):
    def law(estimate):
        raise ZeroDivisionError(estimate.leg)

    trainer.enable()
    with (
        pytest.raises(ZeroDivisionError, match="right"),
        trainer.lease("test", law) as lease,
    ):
        trainer.mode(Mode.TORQUE)
        lease.wait()
    held = long_service.wait_for(record.Mode.HOLD)

    assert held.verdict.cause == record.Cause.NONE
    assert trainer.status().safety.lease_holder is None
