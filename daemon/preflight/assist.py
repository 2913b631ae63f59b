"""Checks of assist and lease: limits, fade and timeouts must fit each other and the axis."""

from typing import Final

from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings

MS_PER_S: Final = 1000.0


def assist_is_part_of_the_effort(settings: Settings) -> Errors:
    """Assist is at most the effort that its axis may give."""
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
            yield ConfigError(settings.file.limits, key, assist_si, allowed)


def a_fade_is_not_too_fast(settings: Settings) -> Errors:
    """A fade of the whole assist changes it no faster than its rate limit."""
    limits, fade_ms = settings.limits, settings.limits.stop.assist_fade_ms
    least_ms, axis = max(
        (MS_PER_S * limits.hip.assist_max_nm / limits.hip.assist_rate_max_nm_per_s, "hip"),
        (MS_PER_S * limits.slide.assist_max_n / limits.slide.assist_rate_max_n_per_s, "slide"),
        key=lambda each: each[0],
    )
    if fade_ms < least_ms:
        allowed = (
            f"at least {least_ms:.0f}, the time in which the {axis} reaches zero at assist_rate_max"
        )
        yield ConfigError(settings.file.limits, "stop.assist_fade_ms", fade_ms, allowed)


def _assist_ends_before_a_silent_gateway_is_a_verdict(settings: Settings) -> Errors:
    limits = settings.limits
    age_cycles, period_ms = limits.assist.setpoint_age_max_cycles, settings.trainer.cycle.period_ms
    silence_ms = limits.communication.gateway_silence_ms
    if age_cycles * period_ms >= silence_ms:
        allowed = f"less than communication.gateway_silence_ms = {silence_ms} of {period_ms} ms"
        yield ConfigError(
            settings.file.limits, "assist.setpoint_age_max_cycles", age_cycles, allowed
        )


def _a_lease_outlives_its_setpoints(settings: Settings) -> Errors:
    lease, path = settings.trainer.lease, settings.file.path
    age_ms = settings.limits.assist.setpoint_age_max_cycles * settings.trainer.cycle.period_ms
    if lease.duration_ms < age_ms:
        allowed = f"at least {age_ms}: setpoint_age_max_cycles of limits.toml"
        yield ConfigError(path, "lease.duration_ms", lease.duration_ms, allowed)
    if lease.duration_max_ms < lease.duration_ms:
        allowed = f"at least lease.duration_ms = {lease.duration_ms}"
        yield ConfigError(path, "lease.duration_max_ms", lease.duration_max_ms, allowed)


ASSIST_CHECKS: Final = (
    assist_is_part_of_the_effort,
    a_fade_is_not_too_fast,
    _assist_ends_before_a_silent_gateway_is_a_verdict,
    _a_lease_outlives_its_setpoints,
)
