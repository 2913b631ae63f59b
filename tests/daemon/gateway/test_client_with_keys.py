"""The client library with credentials, over TLS and a local link: name, role, lease, silence."""

import pytest
from gaitd_client import (
    Assist,
    NoAnswerError,
    NotValid,
    PlanLimits,
    Safety,
    Trainer,
    Trouble,
)
from gaitd_names import Mode
from keyed_gateway import running, status_of

from daemon.keys import issuing

CONTROLLER, OPERATOR = "controller.ward", "operator.desk"
LIMITS = PlanLimits(cadence_max_hz=0.5, amplitude_max_ratio=0.8, duration_max_s=600.0)


@pytest.fixture(scope="module")
def service(fake_core):
    with running(fake_core, {CONTROLLER: True, OPERATOR: False}) as made:
        made.core.changes["mode"] = Mode.TORQUE
        yield made


@pytest.fixture
def controller(service, eventually):
    eventually(lambda: status_of(service.target(OPERATOR)).get("safety", {}).get("valid"))
    folder = service.folder / issuing.ISSUED / CONTROLLER
    with Trainer(credentials=folder, client="claimed") as made:
        yield made


def test_a_lease_has_the_name_of_the_credentials_whatever_is_claimed(
    service, controller, eventually
):
    assist = Assist(2.5, -10.0, 0.5)
    with (
        controller.lease("claimed", lambda _: assist, duration_ms=60_000) as lease,
        Trainer(credentials=service.folder / issuing.ISSUED / OPERATOR) as operator,
    ):
        eventually(lambda: service.core.levels[-1].setpoints)
        (setpoint,) = service.core.levels[-1].setpoints
        assert operator.status().safety.lease_holder == CONTROLLER == lease.name
        assert (setpoint.leg, setpoint.stiffness_ratio) == ("right", 0.5)
        assert (setpoint.hip.assist, setpoint.slide.assist) == assist[:2]

        operator.release_plan(LIMITS)
        assert controller.status().plan == LIMITS
        # A stop ends the lease; it is acquired again, because the machine is not in a stop.
        number = service.core.levels[-1].lease
        operator.stop()
        eventually(lambda: service.core.levels[-1].lease not in {0, number})
    assert controller.status().safety.lease_holder is None


def test_what_a_role_may_not_request_has_no_answer_and_says_so(controller):
    with pytest.raises(NoAnswerError, match="or the role may not request it"):
        controller.enable()


def test_a_core_that_is_silent_makes_nothing_valid_although_the_gateway_answers(
    service, controller
):
    estimates, safety = controller.estimate("right"), controller.safety()
    assert next(item for item in estimates if not isinstance(item, NotValid)).mode == "torque"
    service.core.silent = True

    assert next(item for item in estimates if isinstance(item, NotValid)).trouble is Trouble.SILENT
    assert next(item for item in safety if isinstance(item, Safety) and not item.valid)
    service.core.silent = False
    assert next(item for item in estimates if not isinstance(item, NotValid)).mode == "torque"
    assert next(item for item in safety if isinstance(item, Safety) and item.valid)
