"""A step is judged by the last strides, calmly: one odd stride changes nothing that is told."""

import msgspec
import pytest
from gaitd_client import Stride
from gaitd_session.goals import Band
from gaitd_session.steps import Result, Step, StrideShare, rows_of, step_of, works_against
from hypothesis import given
from hypothesis import strategies as st

BAND = Band(0.3, 0.4)
SHARES = st.lists(st.none() | st.floats(0, 1), min_size=1, max_size=12)


def judged(*shares, band=BAND, against=()):
    strides = [StrideShare("right", share, at in against) for at, share in enumerate(shares)]
    return [step_of(strides[: end + 1], band).result for end in range(len(strides))]


def test_one_odd_stride_changes_nothing_and_a_change_that_lasts_is_told_after_two():
    good, odd = 0.35, 0.9
    assert judged(good, good, odd, good, good) == [Result.WITHIN] * 5
    assert judged(good, good, odd, odd) == [*[Result.WITHIN] * 3, Result.ABOVE]
    assert judged(good, good, 0.1, 0.1)[-1] is Result.BELOW


def test_a_share_that_is_not_known_is_told_at_once_and_is_no_part_of_the_median():
    assert judged(0.35, None) == [Result.WITHIN, Result.UNKNOWN]
    assert judged(0.35, None, 0.33, 0.34)[-1] is Result.WITHIN
    assert step_of([StrideShare("left", None)], BAND) == Step("left", None, Result.UNKNOWN)


def test_without_a_target_nothing_is_judged():
    assert judged(0.1, 0.9, None, band=None) == [
        *[Result.UNJUDGED] * 2,
        Result.UNKNOWN,
    ]
    assert judged(0.1, band=None, against={0}) == [Result.UNJUDGED]


def test_work_against_the_motion_is_told_where_most_of_the_strides_have_it_and_a_low_share_is_not():
    assert judged(0.0, 0.0, 0.0) == [Result.BELOW] * 3
    assert judged(0.0, 0.0, 0.0, against={2})[-1] is Result.BELOW
    assert judged(0.0, 0.0, 0.0, against={1, 2})[-1] is Result.AGAINST


@given(shares=SHARES)
def test_a_step_is_unknown_exactly_where_its_share_is(shares):
    for share, result in zip(shares, judged(*shares), strict=True):
        assert (result is Result.UNKNOWN) == (share is None)


def test_a_row_is_broken_by_a_step_beside_the_target_and_not_by_one_that_is_not_known():
    names = {"+": Result.WITHIN, "-": Result.BELOW, "?": Result.UNKNOWN}

    def rows(signs):
        return rows_of(Step("right", None, names[sign]) for sign in signs)

    assert rows("") == (0, 0)
    assert rows("++?+") == (3, 3)
    assert rows("+++-+") == (1, 3)
    assert rows("++-") == (0, 2)


@pytest.mark.parametrize(
    ("along_j", "against_j", "std_j", "is_against"),
    [
        (0.1, -3.0, 0.5, True),
        (0.1, -0.5, 0.5, False),  # it may be zero
        (4.0, -3.0, 0.1, False),
        (None, -3.0, 0.1, False),
        (0.1, None, 0.1, False),
    ],
)
def test_work_against_the_motion_counts_beyond_its_uncertainty(
    along_j, against_j, std_j, is_against
):
    fields = dict.fromkeys(Stride.__struct_fields__)
    works = {"work_positive_j": along_j, "work_negative_j": against_j}
    works |= {"work_positive_j_std": std_j, "work_negative_j_std": std_j}
    assert works_against(msgspec.structs.replace(Stride(**fields), **works)) is is_against
