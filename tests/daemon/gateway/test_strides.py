"""A stride from the record to its message: once, with its sigmas, null where it was not seen."""

import msgspec
import pytest
from gaitd_client import wire

from daemon.ipc.record import AxisStrideRecord, StrideRecord
from observer.filter.status import Status


def axis(**changes) -> AxisStrideRecord:
    made = AxisStrideRecord(
        work_positive_j=9.7,
        work_positive_j_std=0.1,
        work_negative_j=-0.2,
        work_negative_j_std=0.02,
        assist_mean=3.7,
        assist_mean_std=0.05,
        assist_peak=8.1,
        assist_peak_std=0.2,
        power_mean_w=4.7,
        power_mean_w_std=0.05,
        power_peak_w=15.0,
        power_peak_w_std=0.4,
        share_ratio=0.27,
        share_ratio_std=0.01,
        coverage_ratio=0.9,
    )
    return msgspec.structs.replace(made, **changes)


def stride(number=1, **changes) -> StrideRecord:
    made = StrideRecord(
        number=number,
        end_mono_ns=1_000,
        duration_s=2.0,
        cadence_hz=0.5,
        sample_count=200,
        hip=axis(),
        slide=axis(work_positive_j=46.0, work_positive_j_std=0.7),
        work_positive_j=55.7,
        work_positive_j_std=0.7,
        work_negative_j=-0.6,
        work_negative_j_std=0.1,
        share_ratio=0.2,
        share_ratio_std=0.002,
        status=int(Status.VALID),
        baseline_subtracted=False,
    )
    return msgspec.structs.replace(made, **changes)


@pytest.fixture
def said(bench, make_leg):
    """The messages on right/stride after records with these strides (None: no stride)."""

    def say(*strides):
        for one in strides:
            bench.cycle(legs=(make_leg(stride=one),))
        return bench.outlet.on("right/stride")

    return say


def test_a_stride_is_said_once_in_the_cycle_that_completes_it(said):
    messages = said(None, stride(1), None, None, stride(2), None)

    assert [(message.number, message.cycle, message.seq) for message in messages] == [
        (1, 2, 1),
        (2, 5, 2),
    ]


def test_a_stride_has_its_figures_each_with_its_sigma(said):
    (message,) = said(stride())

    assert isinstance(message, wire.Stride)
    assert (message.hip.work_positive_j, message.hip.work_positive_j_std) == (9.7, 0.1)
    assert (message.slide.work_positive_j, message.slide.work_positive_j_std) == (46.0, 0.7)
    assert (message.hip.assist_mean, message.slide.assist_mean) == (3.7, 3.7)
    assert (message.cadence_hz, message.duration_s) == (0.5, 2.0)
    assert (message.share_ratio, message.hip.coverage_ratio) == (0.2, 0.9)
    assert message.status == ("valid",)
    assert message.baseline_subtracted is False


def test_an_axis_that_was_known_for_less_than_half_of_the_stride_has_no_figures(said):
    (message,) = said(stride(hip=axis(coverage_ratio=0.49)))

    assert message.hip.coverage_ratio == 0.49
    assert message.hip.work_positive_j is message.hip.work_positive_j_std is None
    assert message.hip.share_ratio is message.hip.power_peak_w is None
    assert message.work_positive_j is message.share_ratio is None
    assert message.slide.work_positive_j == 46.0


NO_SHARE = {"share_ratio": None, "share_ratio_std": None}


def test_next_to_no_work_has_no_share(said):
    (message,) = said(stride(**NO_SHARE, hip=axis(**NO_SHARE)))

    assert message.share_ratio is message.hip.share_ratio is message.hip.share_ratio_std is None
    assert message.hip.work_positive_j == 9.7


def test_a_number_that_is_none_is_null(said):
    (message,) = said(
        stride(hip=axis(work_positive_j=float("nan"), work_positive_j_std=float("inf")))
    )

    assert message.hip.work_positive_j is message.hip.work_positive_j_std is None


def test_the_schema_of_a_stride_is_given(bench):
    assert "gaitd.stride.v1" in wire.schemas()
    described = wire.schema(wire.Stride)["properties"]
    assert all(
        "description" in described[name] or name in {"mode", "status", "status_bits"}
        for name in described
        if not name.endswith("_std")
    )


def test_each_leg_has_its_own_strides(bench, make_leg):
    bench.cycle(legs=(make_leg(stride=stride(7)), make_leg(name="left", stride=stride(3))))

    assert [message.number for message in bench.outlet.on("right/stride")] == [7]
    assert [message.number for message in bench.outlet.on("left/stride")] == [3]
