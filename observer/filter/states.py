"""Names and order of the eight states of eq. (23)."""

from typing import Final

STATE_NAMES: Final = (
    "hip_angle_rad",
    "slide_position_m",
    "hip_velocity_rad_per_s",
    "slide_velocity_m_per_s",
    "hip_friction_nm",
    "slide_friction_n",
    "hip_patient_nm",
    "slide_patient_n",
)
STATE_COUNT: Final = len(STATE_NAMES)

POSITION: Final = slice(0, 2)
VELOCITY: Final = slice(2, 4)
FRICTION: Final = slice(4, 6)
PATIENT: Final = slice(6, 8)
