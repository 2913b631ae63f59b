"""The lease: one holder, for a time, by a number that cannot be guessed."""

import secrets

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.config.settings import Lease
from daemon.gateway.lease import NUMBER_BITS, LeaseManager, LeaseRefusedError, draw_number

MS = 1_000_000
RULES = Lease(duration_ms=500, duration_max_ms=2000)


@pytest.fixture
def desk():
    return LeaseManager(RULES)


def test_who_asks_first_holds_it_for_the_configured_time(desk):
    granted = desk.acquire("pusher", None, None, 0)

    assert (granted.duration_ms, granted.renewed) == (500, False)
    assert (desk.number, desk.holder) == (granted.number, "pusher")
    assert desk.tick(500 * MS - 1) is None
    ended = desk.tick(500 * MS)
    assert ended is not None
    assert (ended.client, ended.why) == ("pusher", "expired")
    assert (desk.number, desk.holder) == (0, None)


@pytest.mark.parametrize(
    ("client", "number_off", "code"),
    [
        *(("other", None, "lease_taken"), ("zeta", None, "lease_taken")),
        *(("other", 0, "lease_taken"), ("zeta", 0, "lease_taken")),
        ("".join(("push", "er")), None, "lease_number_wrong"),  # another object of the same name
        ("pusher", 1, "lease_number_wrong"),
    ],
)
def test_a_second_one_is_refused_and_told_who_holds_it(desk, client, number_off, code):
    granted = desk.acquire("pusher", None, None, 0)
    number = None if number_off is None else granted.number + number_off

    with pytest.raises(LeaseRefusedError, match=code) as caught:
        desk.acquire(client, number, None, 1)

    assert str(caught.value) == caught.value.refusal.code == code
    assert caught.value.refusal.values == {"holder": "pusher"}


def test_the_holder_may_acquire_again_and_keeps_its_number(desk):
    granted = desk.acquire("pusher", None, None, 0)

    again = desk.acquire("pusher", granted.number, None, 400 * MS)

    assert (again.number, again.renewed) == (granted.number, True)
    assert desk.tick(899 * MS) is None
    assert desk.tick(900 * MS) is not None


def test_a_number_whose_lease_has_ended_is_not_taken_for_a_new_one(desk):
    granted = desk.acquire("pusher", None, None, 0)
    desk.tick(500 * MS)

    with pytest.raises(LeaseRefusedError, match="lease_over"):
        desk.acquire("pusher", granted.number, None, 501 * MS)
    assert desk.number == 0


def test_an_accepted_setpoint_renews_it(desk):
    desk.acquire("pusher", None, None, 0)
    for ms in range(400, 2001, 400):
        desk.renew(ms * MS)

    assert desk.tick(2499 * MS) is None
    assert desk.tick(2500 * MS) is not None
    desk.renew(2501 * MS)
    assert desk.holder is None


@pytest.mark.parametrize(("wanted", "granted"), [(20, 20), (2000, 2000), (2001, 2000)])
def test_a_wanted_duration_is_given_up_to_the_longest(desk, wanted, granted):
    assert desk.acquire("pusher", None, wanted, 0).duration_ms == granted


def test_the_holder_alone_can_release_it(desk):
    granted = desk.acquire("pusher", None, None, 0)

    number = granted.number
    strangers = (
        ("other", number),
        ("zeta", number),
        ("pusher", number - 1),
        ("pusher", number + 1),
    )
    for client, number in strangers:
        with pytest.raises(LeaseRefusedError, match=r"lease_taken|lease_number_wrong"):
            desk.release(client, number)
    ended = desk.release("pusher", granted.number)

    assert ended == ("pusher", "released")
    with pytest.raises(LeaseRefusedError, match="lease_not_held"):
        desk.release("pusher", granted.number)


def test_it_can_be_ended_whatever_the_holder_thinks(desk):
    assert desk.end("a stop") is None
    desk.acquire("pusher", None, None, 0)

    assert desk.end("a stop") == ("pusher", "a stop")
    assert desk.number == 0


def test_numbers_are_drawn_from_all_that_fit_and_are_never_given_twice():
    script = iter([5, 5, 5, 6, 5, 6, 7])
    desk = LeaseManager(RULES, draw=lambda: next(script))
    given_numbers = []
    for _ in range(3):
        given_numbers.append(desk.acquire("pusher", None, None, 0).number)
        desk.end("test")

    assert given_numbers == [5, 6, 7]
    drawn = [draw_number() for _ in range(2000)]
    assert len(set(drawn)) == 2000
    assert all(0 < number < 2**NUMBER_BITS for number in drawn)
    assert sum(number.bit_count() for number in drawn) / 2000 == pytest.approx(26.5, abs=1)


def test_a_number_is_forgotten_only_after_ten_thousand_others():
    script = iter((*range(1, 10_001), 1, 10_001, 1))
    desk = LeaseManager(RULES, draw=lambda: next(script))

    def given_number():
        desk.end("test")
        return desk.acquire("pusher", None, None, 0).number

    assert [given_number() for _ in range(10_000)] == list(range(1, 10_001))
    assert given_number() == 10_001
    assert given_number() == 1


def test_a_number_is_exact_in_every_reader_and_is_never_none(monkeypatch):
    bits = []
    monkeypatch.setattr(secrets, "randbits", lambda count: bits.append(count) or 0)

    assert draw_number() == 1
    assert bits == [53]


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["acquire", "again", "release", "renew", "tick", "end"]),
        st.sampled_from("ab"),
        st.integers(0, 600),
    ),
    max_size=40,
)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(steps=STEPS)
def test_there_is_never_more_than_one_holder_and_none_without_a_time(steps):
    desk, now_ns = LeaseManager(RULES), 0
    numbers: dict[str, int] = {}
    for step, client, ms in steps:
        now_ns += ms * MS
        before = desk.number
        try:
            if step == "acquire":
                numbers[client] = desk.acquire(client, None, None, now_ns).number
                assert before == 0
            elif step == "again":
                assert desk.acquire(client, numbers.get(client, 1), None, now_ns).renewed
                assert before == numbers[client]
            elif step == "release":
                desk.release(client, numbers.get(client, 1))
                assert before == numbers[client]
        except LeaseRefusedError:
            assert desk.number == before
        if step == "end":
            desk.end("test")
        if step == "renew":
            desk.renew(now_ns)
        if step == "tick":
            desk.tick(now_ns)
        assert (desk.number == 0) == (desk.holder is None)
    desk.tick(now_ns + RULES.duration_ms * MS)
    assert desk.number == 0
