"""Clonus detection: the patient's estimated effort swings to and fro, fast and large.

In clonus a muscle answers each stretch with a contraction that causes the next stretch. Stiff
guidance stretches it again, so guidance softens while clonus lasts, and the machine stops where it
does not end. The estimate is the observer's: this check may only reduce stiffness or add a stop.

Clonus has 5 to 8 Hz (Boyraz, Uysal, Koc, Sarman, "Clonus: definition, mechanism, treatment", Med.
Glas. 12 (2015)), so a half-wave takes 63 to 100 ms. The swing of an effort F is

    (F(t) - 2 F(t - 80 ms) + F(t - 160 ms)) / 4

It has the amplitude of a wave of 6.25 Hz, 0.9 of it at 5 Hz, 0.8 at 8 Hz, 0.06 at 1 Hz, and nothing
of a steady effort. A voluntary effort that is fast makes one or two large swings at a turn of the
gait. In clonus they alternate: each one follows the one of the other direction within 100 ms.
Tremor alternates, too; it is weaker.

A patient may have clonus in bursts, so what counts is its time within a window.
"""

from collections import deque

from daemon.core.safety.energy import StrideSum

HALF_WAVE_MS = 80
"""Half a period of 6.25 Hz, in the middle of the band."""
HALF_WAVE_MAX_MS = 100
"""Half a period of 5 Hz: a swing that comes later follows no other one."""
HALF_WAVES_MIN = 5
"""Alternating swings that are clonus. Patients who work make up to three in a row."""


class ClonusWatch:
    """Clonus detector of one axis."""

    def __init__(self, period_ms: int, window_ms: int) -> None:
        """Begin without any effort.

        Args:
            period_ms: duration of a cycle.
            window_ms: time over which the duration of clonus is summed up.
        """
        self._half_cycles = HALF_WAVE_MS // period_ms
        self._longest_cycles = HALF_WAVE_MAX_MS // period_ms
        self._window_cycles = window_ms // period_ms
        self._lately: deque[float] = deque(maxlen=2 * self._half_cycles + 1)
        self._time = StrideSum()
        self.reset()

    def reset(self) -> None:
        """Forget everything: no motion is guided."""
        self._interrupt()
        self._time.clear()
        self.swing_si = 0.0
        """The largest swing of the newest clonus: N·m or N."""
        self.cycles = 0
        """Time in clonus within the window, in cycles."""
        self.begins = False
        """Clonus has been detected in this cycle, and was not before in the window."""

    @property
    def lasts(self) -> bool:
        """True in clonus."""
        return self._half_waves >= HALF_WAVES_MIN

    def update(self, effort_si: float | None, swing_max_si: float) -> None:
        """Process one cycle.

        Args:
            effort_si: of the patient from the observer, N·m or N; None if it is not usable.
            swing_max_si: swing above which a half-wave counts.
        """
        lasted = self._half_waves >= HALF_WAVES_MIN
        if effort_si is None:
            self._interrupt()
        else:
            self._count_half_waves(effort_si, swing_max_si)
        clonus_cycles = 0
        if self._half_waves >= HALF_WAVES_MIN:
            # Its first half-waves belong to it, once there are enough of them.
            clonus_cycles = 1 if lasted else self._run_cycles
        self.begins = bool(clonus_cycles) and not self.cycles
        if clonus_cycles or self.cycles:
            self._time.add(clonus_cycles)
            self.cycles = round(self._time.so_far(self._window_cycles))

    def _count_half_waves(self, effort_si: float, swing_max_si: float) -> None:
        lately, half_cycles = self._lately, self._half_cycles
        lately.append(effort_si)
        swing_si = 0.0
        if len(lately) > 2 * half_cycles:
            swing_si = 0.25 * (lately[0] - 2.0 * lately[half_cycles] + effort_si)
        self._since_cycles += 1
        self._run_cycles += 1
        if self._since_cycles > self._longest_cycles:
            self._half_waves = 0
        if abs(swing_si) <= swing_max_si:
            return
        if not self._half_waves:
            self._run_cycles, self.swing_si = 1, 0.0
        if not self._half_waves or swing_si * self._last_si < 0.0:
            self._half_waves += 1
            self._since_cycles, self._last_si = 0, swing_si
        self.swing_si = max(self.swing_si, abs(swing_si))

    def _interrupt(self) -> None:
        self._lately.clear()
        self._half_waves = self._since_cycles = self._run_cycles = 0
        self._last_si = 0.0
        """Swing with which the newest half-wave began."""
