import pytest

from gaitd_lab.demonstration.script import (
    PAPER_S,
    Ask,
    Help,
    Kind,
    Patient,
    Plan,
    Scene,
    Situation,
    gait_act,
    paper_act,
    plan_of,
    tiring_act,
    tiring_plan,
)
from gaitd_lab.processes import ServiceError

PLAN = Plan(passive_s=10.0, active_s=20.0, paper_s=25.0)


class Service:
    """A service as the script sees it: does what it is asked, a little later."""

    def __init__(self):
        self.mode, self.verdict, self.outcome, self.reason = "off", "bus down", None, ""
        self.playing_until_s: float | None = None
        self.begins_s = 0.0
        self.artificial = False
        self.refuses: str | None = None
        self.lease_holder: str | None = None

    def do(self, action, now_s):
        if isinstance(action, Help):
            self.lease_holder = "gaitd-assist"
        if isinstance(action, Ask):
            self.outcome = "refused" if action.name == self.refuses else "done"
            self.reason = "because" if action.name == self.refuses else ""
            self.mode = {
                "enable": "hold",
                "disable": "ready",
                "mode": action.payload.get("mode", ""),
            }[action.name]
            if action.name == "mode":
                self.begins_s = now_s + 4.0
                self.playing_until_s = self.begins_s + action.payload["duration_s"]
                self.artificial = action.payload["mode"] == "excite"

    def situation(self, now_s):
        if now_s > 3.0 and self.mode == "off":
            self.mode, self.verdict = "ready", ""
        playing = self.playing_until_s is not None and self.begins_s <= now_s < self.playing_until_s
        if self.playing_until_s is not None and now_s >= self.playing_until_s:
            self.mode, self.playing_until_s = "hold", None
        return Situation(
            now_s=now_s,
            received_s=now_s,
            mode=self.mode,
            verdict=self.verdict,
            phase_ratio=0.5 if playing and not self.artificial else None,
            artificial=playing and self.artificial,
            lease_holder=self.lease_holder,
            outcome=self.outcome,
            reason=self.reason,
        )


def play(act, service, until_s=1000.0):
    """Time of each action, by simulated seconds."""
    now_s, did = 0.0, []
    action = next(act)
    while now_s < until_s:
        if action is not None:
            did.append((now_s, action))
            service.do(action, now_s)
        now_s += 0.1
        try:
            action = act.send(service.situation(now_s))
        except StopIteration:
            return did
    raise AssertionError("the act does not end")


def test_gait_is_played_without_and_then_with_the_patient():
    did = play(gait_act(PLAN), Service())

    asked = [action.name for _, action in did if isinstance(action, Ask)]
    assert asked == ["enable", "mode", "disable"]
    programmes = [(at, action.programme) for at, action in did if isinstance(action, Patient)]
    assert [name for _, name in programmes] == ["passive", "active", "passive"]
    spans = {action.kind: at for at, action in did if isinstance(action, Scene)}
    assert programmes[1][0] - spans[Kind.PASSIVE] == pytest.approx(10.0, abs=0.5)
    assert programmes[2][0] - spans[Kind.ACTIVE] == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("helped", [False, True])
def test_a_patient_who_tires_is_helped_only_by_a_controller_that_holds_the_lease(helped):
    did = play(tiring_act(tiring_plan(60.0), helped=helped), Service())

    order = [action for _, action in did if not isinstance(action, Scene)]
    assert [one.name for one in order if isinstance(one, Ask)] == ["enable", "mode", "disable"]
    assert [one.programme for one in order if isinstance(one, Patient)] == ["tiring", "passive"]
    assert [type(one) for one in order[1:-3]] == ([Help, Ask] if helped else [Ask])
    spans = [action for _, action in did if isinstance(action, Scene)]
    assert [one.lasting_s for one in spans if one.kind is Kind.TIRING] == [30.0]


def test_without_a_lease_the_gait_with_help_does_not_begin():
    class Alone(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(lease_holder=None)

    with pytest.raises(ServiceError, match="no lease within"):
        play(tiring_act(tiring_plan(60.0), helped=True), Alone())


def test_the_paper_s_experiment_is_asked_for_by_name_and_judged_while_it_plays():
    did = play(paper_act(PLAN), Service())

    mode = next(action for _, action in did if isinstance(action, Ask) and action.name == "mode")
    assert mode.payload == {"mode": "excite", "scenario": "paper", "duration_s": 25.0}
    assert any(isinstance(a, Scene) and a.kind is Kind.OPEN_LOOP for _, a in did)


@pytest.mark.parametrize("refused", ["enable", "mode", "disable"])
def test_a_refusal_ends_the_act_with_its_reason(refused):
    service = Service()
    service.refuses = refused

    with pytest.raises(ServiceError, match=f"{refused} refused: because"):
        play(gait_act(PLAN), service)


class Stopping(Service):
    """Stops by itself at a time."""

    def __init__(self, at_s, mode):
        super().__init__()
        self.at_s, self.into = at_s, mode

    def situation(self, now_s):
        now = super().situation(now_s)
        if now_s < self.at_s:
            return now
        return now._replace(mode=self.into, verdict="S1 the hand switch is open at right/hip")


@pytest.mark.parametrize("into", ["stopping", "fault", "off"])
def test_a_stop_ends_the_act_with_its_cause(into):
    with pytest.raises(ServiceError, match="hand switch"):
        play(gait_act(PLAN), Stopping(at_s=20.0, mode=into))


def test_a_silent_service_ends_the_act():
    class Silent(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(received_s=min(now_s, 15.0))

    with pytest.raises(ServiceError, match="no word from the service"):
        play(gait_act(PLAN), Silent())


def test_a_service_that_never_gets_ready_ends_the_act_in_time():
    class Off(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(mode="off", verdict="no drives")

    with pytest.raises(ServiceError, match="no ready within 900 s; the mode is off"):
        play(gait_act(PLAN), Off())


@pytest.mark.parametrize(
    ("seconds", "paper_s"), [(6.0, 0.0), (39.0, 0.0), (40.0, 25.0), (90.0, 25.0)]
)
def test_the_seconds_of_movement_are_shared_as_the_help_says(seconds, paper_s):
    plan = plan_of(seconds)

    assert plan.total_s == pytest.approx(seconds)
    assert plan.paper_s == paper_s
    assert plan.active_s == pytest.approx(2 * plan.passive_s)


def test_by_default_it_is_ten_seconds_without_and_twenty_with_the_patient():
    plan = plan_of(55.0)

    assert (plan.passive_s, plan.active_s, plan.paper_s) == (10.0, 20.0, PAPER_S)
