"""Profiles of tests of `clients/session`."""

from pathlib import Path

from gaitd_session import Profile, parse_profile

PROFILE = """
version = 1
id = "7f3k9m2q"
legs = ["right"]

[range]
cadence_min_hz = 0.2
cadence_max_hz = 0.5
amplitude_min_ratio = 0.3
amplitude_max_ratio = 0.8

[assist]
hip.max_nm = 10.0
slide.max_n = 80.0

[goal]
share_min_ratio = 0.1
share_max_ratio = 0.6
share_start_ratio = 0.3
band_width_ratio = 0.1
challenge_ratio = 0.02
step_max_ratio = 0.05
in_band_goal_ratio = 0.6

[plan.warm_up]
duration_s = 10.0
cadence_hz = 0.5
amplitude_ratio = 0.4
rest_s = 2.0

[[plan.block]]
duration_s = 12.0
cadence_hz = 0.5
amplitude_ratio = 0.6
rest_s = 3.0
"""
PASSIVE = """
[plan.passive]
duration_s = 80.0
cadence_hz = 0.25
amplitude_ratio = 0.8
rest_s = 0
"""


def profile() -> Profile:
    """A patient with a warm-up and one block."""
    return parse_profile(PROFILE, Path("profile.toml"))
