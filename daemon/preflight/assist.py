"""Checks of assist and lease: limits, fade and timeouts must fit each other and the axis."""

from typing import Final

from daemon.config.bundle import Settings
from daemon.config.strict import ConfigError

MS_PER_S: Final = 1000.0


def _assist_is_part_of_what_the_axis_may_give(settings: Settings) -> None:
    for key, assist_si, whole_key, whole_si in (
        (
            "hip.assist_max_nm",
            settings.limits.hip.assist_max_nm,
            "hip.torque_max_nm",
            settings.limits.hip.torque_max_nm,
        ),
        (
            "slide.assist_max_n",
            settings.limits.slide.assist_max_n,
            "slide.force_max_n",
            settings.limits.slide.force_max_n,
        ),
    ):
        if assist_si > whole_si:
            allowed = f"at most {whole_key} = {whole_si:g}"
            raise ConfigError(settings.file.limits, key, assist_si, allowed)


def _a_fade_is_no_faster_than_assist_may_change(settings: Settings) -> None:
    limits = settings.limits
    fade_s = limits.stop.assist_fade_ms / MS_PER_S
    for axis, assist_si, rate_si_per_s in (
        ("hip", limits.hip.assist_max_nm, limits.hip.assist_rate_max_nm_per_s),
        ("slide", limits.slide.assist_max_n, limits.slide.assist_rate_max_n_per_s),
    ):
        if assist_si > rate_si_per_s * fade_s:
            least_ms = assist_si / rate_si_per_s * MS_PER_S
            allowed = (
                f"at least {least_ms:.0f}, the time in which the {axis} reaches zero at"
                " assist_rate_max"
            )
            raise ConfigError(
                settings.file.limits, "stop.assist_fade_ms", limits.stop.assist_fade_ms, allowed
            )


def _assist_ends_before_a_silent_gateway_is_a_verdict(settings: Settings) -> None:
    limits = settings.limits
    age_cycles, period_ms = limits.assist.setpoint_age_max_cycles, settings.trainer.cycle.period_ms
    silence_ms = limits.communication.gateway_silence_ms
    if age_cycles * period_ms >= silence_ms:
        allowed = f"less than communication.gateway_silence_ms = {silence_ms} of {period_ms} ms"
        raise ConfigError(
            settings.file.limits, "assist.setpoint_age_max_cycles", age_cycles, allowed
        )


def _a_lease_outlives_its_setpoints(settings: Settings) -> None:
    lease, path = settings.trainer.lease, settings.file.path
    age_ms = settings.limits.assist.setpoint_age_max_cycles * settings.trainer.cycle.period_ms
    if lease.duration_ms < age_ms:
        allowed = f"at least {age_ms}: setpoint_age_max_cycles of limits.toml"
        raise ConfigError(path, "lease.duration_ms", lease.duration_ms, allowed)
    if lease.duration_max_ms < lease.duration_ms:
        allowed = f"at least lease.duration_ms = {lease.duration_ms}"
        raise ConfigError(path, "lease.duration_max_ms", lease.duration_max_ms, allowed)


ASSIST_CHECKS: Final = (
    _assist_is_part_of_what_the_axis_may_give,
    _a_fade_is_no_faster_than_assist_may_change,
    _assist_ends_before_a_silent_gateway_is_a_verdict,
    _a_lease_outlives_its_setpoints,
)
