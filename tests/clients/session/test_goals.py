"""The target band follows the patient, within the therapist's bounds, and no single stride."""

import msgspec
import pytest
from gaitd_client import Mode, StatusBit, Stride
from gaitd_session.goals import STRIDES_MIN, band_about, next_middle, valid_share
from hypothesis import given
from hypothesis import strategies as st
from training import profile

GOAL = profile().goal
SHARES = st.lists(st.floats(0, 1), max_size=30)


@given(middle=st.floats(0, 1), shares=SHARES)
def test_the_middle_stays_in_its_bounds_and_moves_by_one_step_at_most(middle, shares):
    before = band_about(middle, GOAL).middle_ratio
    after = next_middle(before, shares, GOAL, is_first=False)
    band = band_about(after, GOAL)

    assert GOAL.share_min_ratio <= after <= GOAL.share_max_ratio
    assert abs(after - before) <= GOAL.step_max_ratio + 1e-12
    assert 0 <= band.low_ratio <= after <= band.high_ratio <= 1
    if len(shares) < STRIDES_MIN:
        assert after == before


@given(shares=st.lists(st.floats(0.25, 0.35), min_size=11, max_size=30), wild=st.floats(0, 1))
def test_fewer_wild_strides_than_half_leave_the_band_among_the_others(shares, wild):
    after = next_middle(0.3, shares + [wild] * (len(shares) // 2), GOAL, is_first=False)

    assert 0.25 <= after - GOAL.challenge_ratio <= 0.35


def test_the_middle_of_the_band_follows_equation_1():
    def after(middle, share, count=5, *, is_first=False):
        return next_middle(middle, [share] * count, GOAL, is_first=is_first)

    assert after(0.3, 0.31) == pytest.approx(0.33)
    assert after(0.3, 0.1) == pytest.approx(0.25)
    assert after(0.3, 0.9) == pytest.approx(0.35)
    assert after(0.59, 0.9) == 0.6
    # The first block proposes the band, within the therapist's bounds.
    assert after(0.3, 0.5, is_first=True) == pytest.approx(0.52)
    assert after(0.3, 0.9, is_first=True) == 0.6
    assert after(0.3, 0.0, is_first=True) == 0.1
    assert after(0.3, 0.5, count=STRIDES_MIN - 1, is_first=True) == 0.3


def stride(share, status=(StatusBit.VALID,), mode=Mode.GAIT):
    fields = dict.fromkeys(Stride.__struct_fields__)
    return Stride(**{**fields, "share_ratio": share, "status": status, "mode": mode})


@pytest.mark.parametrize(
    ("made", "share"),
    [
        (stride(0.4), 0.4),
        (stride(None), None),
        (stride(1.5), None),
        (stride(float("nan")), None),
        (stride(0.4, (StatusBit.ARTIFICIAL,)), None),
        (stride(0.4, mode=Mode.TORQUE), None),
    ],
    ids=repr,
)
def test_a_share_that_is_not_one_is_not_valid(made, share):
    assert valid_share(msgspec.structs.replace(made)) == share
