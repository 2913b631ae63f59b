import pytest
from gaitd_session import Advice, Button, Phase

from gaitd_lab.demonstration import training_script
from gaitd_lab.demonstration.script import (
    ACTIVE,
    PAPER_S,
    PASSIVE,
    TIRING,
    Kind,
    Plan,
    Scene,
    Situation,
    gait_act,
    paper_act,
    plan_of,
    tiring_act,
)
from gaitd_lab.demonstration.training_script import (
    HOLD,
    LET_GO,
    PRESS_STOP,
    RELEASE_STOP,
    Seen,
    Training,
    training_act,
)
from gaitd_lab.processes import ServiceError
from gaitd_lab.requests import Ask

PLAN = Plan(passive_s=10.0, active_s=20.0, paper_s=25.0)


ASSIST = "the assist is started"


class Stage:
    """Simulated seconds, and all that an act did, with its time."""

    def __init__(self):
        self.now_s, self.did = 0.0, []

    def turn(self):
        self.now_s += 0.1
        assert self.now_s < 1000.0, "the act does not end"
        return self.situation(self.now_s)

    def situation(self, now_s):
        raise NotImplementedError

    def begin(self, scene):
        self.did.append((self.now_s, scene))

    def drives(self, command):
        self.did.append((self.now_s, command))

    def all(self, kind):
        return [one for _, one in self.did if isinstance(one, kind)]

    def at_s(self, wanted):
        """The time of an act's only one."""
        (at_s,) = [at_s for at_s, one in self.did if one == wanted or one[1:2] == (wanted,)]
        return at_s


class Service(Stage):
    """A service as the script sees it: does what it is asked, a little later."""

    def __init__(self):
        super().__init__()
        self.mode, self.verdict, self.outcome, self.reason = "off", "bus down", None, ""
        self.playing_until_s: float | None = None
        self.begins_s = 0.0
        self.artificial = False
        self.refuses: str | None = None
        self.lease_holder: str | None = None

    def start_assist(self):
        self.did.append((self.now_s, ASSIST))
        self.lease_holder = "gaitd-assist"

    def ask(self, name, payload):
        self.did.append((self.now_s, Ask(name, payload)))
        self.outcome = "refused" if name == self.refuses else "done"
        self.reason = "because" if name == self.refuses else ""
        self.mode = {"enable": "hold", "disable": "ready", "mode": payload.get("mode", "")}[name]
        if name == "mode":
            self.begins_s = self.now_s + 4.0
            self.playing_until_s = self.begins_s + payload["duration_s"]
            self.artificial = payload["mode"] == "excite"

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


def test_gait_is_played_without_and_then_with_the_patient():
    service = Service()
    gait_act(service, PLAN)

    assert [one.name for one in service.all(Ask)] == ["enable", "mode", "disable"]
    assert service.all(str) == [PASSIVE, ACTIVE, PASSIVE]
    begins_s = service.at_s(Kind.PASSIVE)
    assert service.at_s(Kind.ACTIVE) - begins_s == pytest.approx(10.0, abs=0.2)
    assert service.at_s(ACTIVE) == service.at_s(Kind.ACTIVE)
    end_s = [at_s for at_s, one in service.did if one == PASSIVE][1]
    assert end_s - begins_s == pytest.approx(30.0, abs=0.2)


@pytest.mark.parametrize("helped", [False, True])
def test_a_patient_who_tires_is_helped_only_by_a_controller_that_holds_the_lease(helped):
    service = Service()
    tiring_act(service, 30.0, helped=helped)

    order = [one.name if isinstance(one, Ask) else one for _, one in service.did]
    order = [one for one in order if isinstance(one, str)]
    start = [ASSIST] if helped else []
    assert order == ["enable", *start, "mode", TIRING, PASSIVE, "disable"]
    (scene,) = [one for one in service.all(Scene) if one.kind is Kind.TIRING]
    assert scene.lasting_s == 30.0


def test_without_a_lease_the_gait_with_help_does_not_begin():
    class Alone(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(lease_holder=None)

    with pytest.raises(ServiceError, match="no lease within"):
        tiring_act(Alone(), 30.0, helped=True)


def test_the_paper_s_experiment_is_asked_for_by_name_and_judged_while_it_plays():
    service = Service()
    paper_act(service, 25.0)

    mode = next(one for one in service.all(Ask) if one.name == "mode")
    assert mode.payload == {"mode": "excite", "scenario": "paper", "duration_s": 25.0}
    lasted_s = service.at_s(Scene("the drives are switched off")) - service.at_s(Kind.OPEN_LOOP)
    assert lasted_s == pytest.approx(25.0, abs=0.2)


@pytest.mark.parametrize("refused", ["enable", "mode", "disable"])
def test_a_refusal_ends_the_act_with_its_reason(refused):
    service = Service()
    service.refuses = refused

    with pytest.raises(ServiceError, match=f"{refused} refused: because"):
        gait_act(service, PLAN)


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
        gait_act(Stopping(at_s=20.0, mode=into), PLAN)


def test_a_silent_service_ends_the_act():
    class Silent(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(received_s=min(now_s, 15.0))

    with pytest.raises(ServiceError, match="no word from the service"):
        gait_act(Silent(), PLAN)


def test_a_service_that_never_gets_ready_ends_the_act_in_time():
    class Off(Service):
        def situation(self, now_s):
            return super().situation(now_s)._replace(mode="off", verdict="no drives")

    with pytest.raises(ServiceError, match="no ready within 900 s; the mode is off"):
        gait_act(Off(), PLAN)


@pytest.mark.parametrize(
    ("seconds", "paper_s"), [(6.0, 0.0), (39.0, 0.0), (40.0, 25.0), (90.0, 25.0)]
)
def test_the_seconds_of_movement_are_shared_as_the_help_says(seconds, paper_s):
    plan = plan_of(seconds)

    assert sum(plan) == pytest.approx(seconds)
    assert plan.paper_s == paper_s
    assert plan.active_s == pytest.approx(2 * plan.passive_s)


def test_by_default_it_is_ten_seconds_without_and_twenty_with_the_patient():
    plan = plan_of(55.0)

    assert (plan.passive_s, plan.active_s, plan.paper_s) == (10.0, 20.0, PAPER_S)


# --- a training -----------------------------------------------------------------------------------


class Page(Stage):
    """A patient's page, and the service behind it: each step takes two seconds."""

    STEPS = ("enabling", "announced", "self_test", "announced", "starting", "walking")
    AGAIN = ("enabling", "announced", "starting", "walking")

    def __init__(self, blocks=3, presses_alone=False):
        super().__init__()
        self.blocks, self.presses_alone = blocks, presses_alone
        self.mode, self.phase, self.walked = "off", "waiting", 0
        self.is_held = self.is_released = True
        self.has_plan = False
        self.coming, self.next_s, self.presses = [], 0.0, 0
        self.refuses = self.advises = None
        self.released = None

    def drives(self, command):
        super().drives(command)
        if command in {HOLD, LET_GO}:
            self.is_held = command == HOLD
        elif command in {PRESS_STOP, RELEASE_STOP}:
            self.is_released = command == RELEASE_STOP
            self.mode = "fault"

    def release(self):
        self.released = "refused" if self.refuses else "done"
        self.has_plan = not self.refuses

    def outcome(self):
        return self.released, "because"

    def press(self, button):
        assert button == "start"
        self.presses += 1
        self.start(self.now_s)

    @property
    def seen(self):
        return Seen(self.mode, Training(self.phase, self.advice(), self.buttons()))

    def start(self, now_s):
        assert self.may_start()
        if self.mode == "fault":
            self.mode = "ready"
            return
        assert self.has_plan
        self.coming = list(self.STEPS if self.walked == 0 else self.AGAIN)
        self.next_s = now_s

    @property
    def rests(self):
        return self.phase == "rest" and self.now_s < self.next_s

    def may_start(self):
        is_at_rest = self.phase in {"waiting", "rest", "stopped"} and not self.rests
        return self.is_held and self.is_released and is_at_rest

    def situation(self, now_s):
        if now_s > 3.0 and self.mode == "off":
            self.mode = "ready"
        if self.phase not in {"waiting", "rest", "stopped", "finished"}:
            assert self.is_held
        if self.presses_alone and now_s % 10 < 0.1 and self.may_start() and not self.coming:
            self.start(now_s)
        if self.coming and now_s >= self.next_s:
            self.phase, self.next_s = self.coming.pop(0), now_s + 2.0
            if self.phase == "walking":
                self.walked += 1
                self.next_s = now_s + 10.0
                self.coming = ["finished" if self.walked == self.blocks else "rest"]
        return Situation(
            now_s=now_s,
            received_s=now_s,
            mode=self.mode,
            verdict="S1 something" if self.mode == "fault" else "",
            phase_ratio=None,
            artificial=False,
        )

    def advice(self):
        if self.advises is not None and self.phase == "walking":
            return self.advises
        if self.mode == "fault":
            return "press_start_to_reset" if self.is_held else "hold_hand_switch"
        if self.rests:
            return "rest"
        if self.phase in {"waiting", "rest"}:
            return "press_start" if self.is_held else "hold_hand_switch"
        return "walk" if self.phase == "walking" else "lie_still"

    def buttons(self):
        return ("start", "end") if self.may_start() else ("end",)


def test_the_words_of_the_scripted_patient_are_those_of_the_session():
    assert set(Advice) > training_script.HOLDS | training_script.LETS_GO | training_script.LOST
    assert {*training_script.TITLES, training_script.FINISHED} == set(Phase)
    assert training_script.WALKING in training_script.TITLES
    assert training_script.START == Button.START


def test_a_patient_alone_does_as_the_page_says_until_three_blocks_are_walked():
    page = Page()
    training_act(page, page, 3)

    assert (page.walked, page.phase) == (3, "finished")
    assert page.presses == 4, "RESET of the daily test, and each block"
    commands = page.all(str)
    assert [one for one in commands if one in {PRESS_STOP, RELEASE_STOP}] == [
        PRESS_STOP,
        RELEASE_STOP,
    ]
    held = [one == HOLD for one in commands if one in {HOLD, LET_GO}]
    assert held == [False, True, False, True, False, True, False], "daily test, rests, the end"
    patient = [one for one in commands if one in {ACTIVE, PASSIVE}]
    assert patient == 3 * [ACTIVE, PASSIVE]
    titles = [scene.title for scene in page.all(Scene)]
    assert [title for title in titles if title.startswith("block")] == [
        f"block {number} of 3: the patient walks" for number in (1, 2, 3)
    ]


def test_with_hands_on_a_person_presses_the_buttons_and_is_told_to():
    page = Page(presses_alone=True)
    training_act(page, page, 3, hands_on="http://127.0.0.1:8080/")

    assert page.walked == 3
    assert page.presses == 0
    asked = [one for one in page.all(Scene) if "press START" in one.title]
    assert len(asked) == 4
    assert all("http://127.0.0.1:8080/" in one.title for one in asked)


def test_a_plan_that_is_not_released_ends_the_training_with_its_reason():
    page = Page()
    page.refuses = "plan"

    with pytest.raises(ServiceError, match=r"release refused: because"):
        training_act(page, page, 3)


def test_a_page_that_sends_for_help_ends_the_training_with_its_words():
    page = Page()
    page.advises = "call_for_help"

    with pytest.raises(ServiceError, match="the page says call_for_help"):
        training_act(page, page, 3)


def test_a_phase_without_end_ends_the_training():
    page = Page()
    page.STEPS = ("enabling",)

    with pytest.raises(ServiceError, match="no end of enabling within"):
        training_act(page, page, 3)
