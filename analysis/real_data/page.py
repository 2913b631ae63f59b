"""Page of the observer on recordings of real machines: tables in Markdown and pictures beside."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from analysis import markdown
from analysis.real_data.comparison import (
    CALIBRATED,
    CERTAIN,
    INVERSE,
    MOMENTUM,
    NOISE,
    PAPER,
    PUBLISHED,
    Comparison,
)
from analysis.real_data.figures import draw_axis, draw_speed
from analysis.real_data.judgement import Score
from daemon.config.robot import friction_parameters

NAME: Final = "real_data"
HEAD: Final = (
    *("estimator", "no pulses, N", "pulses left in, N", "as disturbance, N", "50 ms, N"),
    *("reversals, N", "3σ", "3σ, reversals", "σ, N", "NIS", "50 %, ms", "90 %, ms", "× gaitd"),
)
ASKED_HEAD: Final = ("asked", "published", "calibrated", "with its noise")

BEGIN: Final = """# The observer on recordings of real machines

The other pages judge the observer on the virtual machine, which is ours. This one uses recordings
of others, which are not part of gaitd. It is written by

```sh
{run}
```

## A servo axis with known pulses

EMPS (A. Janot, M. Gautier, M. Brunot, *Data set and reference models of EMPS*, Workshop on
Nonlinear System Identification Benchmarks, 2019): a maxon motor moves a carriage of 95 kg over a
ball screw, 25 s under position control, twice. The data state no licence, so they are not here;
the folder `emps` of the recordings has `DATA_EMPS.mat` and `DATA_EMPS_PULSES.mat` as published. In
the second record {pulses} pulses of {height} N were added to the drive's command. A force that
acts and that the observer does not see is the paper's artificial disturbance, eq. (9) and (21).

The observer is the service's own, with the carriage as the slide of a leg without weight, in rows
of 10 ms: position at the row's end, force as its mean. **All tuning uses the first record, which
has no pulses.** `gaitd calibrate` found {coulomb} N of Coulomb friction, {viscous} N s/m and
{mass} kg (published: 20.4, 203.5, 95.1), a constant of {offset} N, and {encoder} µm of encoder
noise where the shipped file has 25; with `--noise` a noise of {velocity} µm/s and {friction} N per
step where it has 500 and 1.
"""
COLUMNS: Final = """Rms error of the external force while the carriage moves (above 10 mm/s), from
0.5 s on. *No pulses* is the first record, true force 0, the one that was fitted; *pulses left in*
the second one with all of the force seen, true force 0; *as disturbance* the second one with the
pulses hidden, 150 ms after an edge and later. *50 ms*, 3σ, σ (median) and NIS are the same from
50 ms after an edge on; *reversals* are the rows below 10 mm/s. NIS is of one axis, so 1 is ideal.
50 % and 90 % of a step are times in the mean response to all edges. The smoother uses 150 ms after
a row, so it is not judged in the 150 ms before an edge. The last column is the error as
disturbance over that of the calibrated observer.
"""
REASONS: Final = """**Why NIS was 0.1.** Friction and encoder noise are not the cause: with both
calibrated it is {plain_nis}. The shipped process noise of 0.5 mm/s of velocity per step is 0.8 N
on the 16 kg of the trainer's slide, and 4.7 N on this carriage: the observer expected far more than
happened. `--noise` takes it from the record. Then NIS is in its band on the validation record,
sigma is smaller, and the observer is faster, at the cost of {noise_costs} more error.

**Reversals.** What the law of friction does not explain is small in steady motion and large where
the carriage reverses, and stays the same for many rows, so it is no noise of a step: with the law
taken as certain 3σ covers {certain_slow_coverage} at reversals, {slow_share} of the rows. From the
first record `--noise` also takes how wrong the law is there, {law} N at standstill and a quarter of
that at {law_speed} mm/s. It is added to the reported sigma of friction and patient, and to nothing
else: then 3σ covers {slow_coverage}. The distribution of NIS is still not quite right: {usual} of
the samples are below the 95 % quantile.

![position, velocity, force, friction and disturbance](real_data_slide.png)

The calibrated observer. Orange in (d) is what inertia leaves of the exerted force, through a
low-pass without delay: no model of friction is in it.
"""
BESIDE: Final = """### Beside other estimators

All know the calibrated mass, offset and friction; the first row alone has the published ones. The
momentum observer (A. De Luca, R. Mattone, ICRA 2005) and inverse dynamics have the static law of
eq. (13), and the bandwidth with which they reach 90 % of a step as fast as the observer with its
noise ({momentum_bandwidth} and {inverse_bandwidth} rad/s). The paper's tuning has constant noise,
friction's ten times the disturbance's, and no Coriolis torque, which this axis does not have.

- At that speed the momentum observer's error is {momentum_more} than that of the observer with its
  noise, and that of inverse dynamics {inverse_more}; at reversals {momentum_slow_more} and
  {inverse_slow_more}.
- At other bandwidths neither comes below {best} N; the calibrated observer has {plain_false} N, and
  90 % of a step after {plain_ninety} ms.
- **They begin faster**: 50 % of a step after {momentum_half} and {inverse_half} ms, the observer
  after {noise_half}. With an encoder this fine a step of {height} N looks like a glitch, and the
  observer rejects the first sample after it. Error over all rows, edges included: {momentum_whole},
  {inverse_whole} and {noise_whole} N. They have no such gate, and follow a glitch.
- The paper's tuning is as good as ours on this axis: {paper_false} N, {paper_ninety} ms,
  {paper_slow} N at reversals. The choices that differ concern rest ([ablation.md](ablation.md)).
- Calibration matters most: with published parameters and the shipped noise the error is
  {first_more} and 90 % of a step takes {first_ninety} ms.

So on one axis of constant mass with a fine encoder, a Kalman filter of eight states gains little
over classical estimators that are given its friction law. They have no sigma and no friction at
rest.

![step response, and error over speed](real_data_speed.png)
"""


def rows(found: Comparison) -> list[tuple[str, ...]]:
    """One row for each estimator."""
    reference = found.scores[CALIBRATED][-1].false_n
    return [_row(name, scores, reference) for name, scores in found.scores.items()]


def write_page(
    folder: Path, found: Comparison, run: str, more: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Write the page and its pictures.

    Args:
        folder: exists.
        found: results on the recorded axis.
        run: the command.
        more: further parts of the page.

    Raises:
        OSError: a file cannot be written.
    """
    axis, speed = (folder / f"{NAME}_{name}.png" for name in ("slide", "speed"))
    draw_axis(found, axis)
    draw_speed(found, speed)
    words = {"run": run} | _of_axis(found) | _of_reasons(found) | _of_others(found)
    parts = (
        BEGIN.format_map(words),
        markdown.table(HEAD, rows(found), 1),
        COLUMNS,
        markdown.table(ASKED_HEAD, _asked(found), 1),
        REASONS.format_map(words),
        BESIDE.format_map(words),
    )
    path = folder / f"{NAME}.md"
    path.write_text(markdown.page(*parts, *more), encoding="utf-8")
    return path, axis, speed


def _row(name: str, scores: tuple[Score, ...], reference: float) -> tuple[str, ...]:
    clean, left_in, disturbed = scores
    return (
        name,
        _number(clean.whole_n, 2),
        _number(left_in.whole_n, 2),
        _number(disturbed.false_n, 2),
        _number(disturbed.early_n, 2),
        _number(disturbed.slow_n, 1),
        _number(disturbed.covered_ratio, 3),
        _number(disturbed.slow_covered_ratio, 2),
        _number(disturbed.sigma_n, 2),
        _number(disturbed.nis, 2),
        _number(1e3 * disturbed.half_s, 0),
        _number(1e3 * disturbed.ninety_s, 0),
        _number(disturbed.false_n / reference, 2),
    )


def _asked(found: Comparison) -> Iterator[tuple[str, ...]]:
    def row(title: str, field: str, digits: int, situation: int = 2) -> tuple[str, ...]:
        scores = (found.scores[name][situation] for name in (PUBLISHED, CALIBRATED, NOISE))
        return title, *(_number(getattr(one, field), digits) for one in scores)

    low, high = found.scores[NOISE][2].nis_band
    yield row("coverage of 3σ ≥ 0.99, moving", "covered_ratio", 3)
    yield row("the same at reversals", "slow_covered_ratio", 3)
    yield row("median σ not above that of the published, N", "sigma_n", 2)
    yield row(f"NIS {low:.2f} to {high:.2f}, as disturbance", "nis", 2)
    yield row("NIS, pulses left in", "nis", 2, 1)
    yield row("share of NIS up to 3.84 (0.95 is ideal)", "nis_usual_ratio", 3)


def _of_axis(found: Comparison) -> dict[str, str]:
    values = {
        one.quantity.label: one.value for one in found.calibration.fit.results if one.calibrated
    }
    noise, seen = found.calibration.process_noise, found.situations[-1]
    law = friction_parameters(found.calibration.robot)[1]
    return {
        "pulses": str((len(seen.edges_s) + 1) // 2),
        "height": _number(float(seen.truth_n.max()), 0),
        "coulomb": _number(values["slide coulomb"], 1),
        "viscous": _number(values["slide viscous"], 0),
        "mass": _number(values["slide drive mass"], 1),
        "offset": _number(found.offset_n, 2),
        "encoder": _number(1e6 * values["slide encoder noise"], 2),
        "velocity": _number(1e6 * noise["process_slide_velocity_m_per_s"], 0),
        "friction": _number(noise["process_slide_friction_n"], 1),
        "law": _number(found.calibration.robot.observer.law_slide_n, 1),
        "law_speed": _number(1e3 * math.sqrt(3.0) * (law.transition + law.peak), 0),
    }


def _of_reasons(found: Comparison) -> dict[str, str]:
    noise, plain, certain = (found.scores[name][-1] for name in (NOISE, CALIBRATED, CERTAIN))
    slow, moving = (
        np.count_nonzero(one)
        for one in (found.situations[-1].slow(), found.situations[-1].moving())
    )
    return {
        "plain_nis": _number(plain.nis, 2),
        "noise_costs": _share(noise.false_n / plain.false_n - 1.0),
        "usual": _share(noise.nis_usual_ratio),
        "slow_share": _share(slow / (slow + moving)),
        "slow_coverage": _share(noise.slow_covered_ratio),
        "certain_slow_coverage": _share(certain.slow_covered_ratio),
    }


def _of_others(found: Comparison) -> dict[str, str]:
    names = {
        **{"first": PUBLISHED, "plain": CALIBRATED, "noise": NOISE, "paper": PAPER},
        **{"momentum": MOMENTUM, "inverse": INVERSE},
    }
    scores = {word: found.scores[name][-1] for word, name in names.items()}
    words: dict[str, str] = {
        "best": _number(min(one[1] for curve in found.trade.values() for one in curve), 2),
        "first_more": _more(scores["first"].false_n, scores["plain"].false_n),
    }
    for word, score in scores.items():
        words |= {
            f"{word}_false": _number(score.false_n, 2),
            f"{word}_whole": _number(score.whole_n, 0),
            f"{word}_slow": _number(score.slow_n, 1),
            f"{word}_half": _number(1e3 * score.half_s, 0),
            f"{word}_ninety": _number(1e3 * score.ninety_s, 0),
        }
    for word in ("momentum", "inverse"):
        words |= {
            f"{word}_bandwidth": _number(found.bandwidths[names[word]], 0),
            f"{word}_more": _more(scores[word].false_n, scores["noise"].false_n),
            f"{word}_slow_more": _more(scores[word].slow_n, scores["noise"].slow_n),
        }
    return words


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _share(value: float) -> str:
    return f"{100.0 * value:.0f} %"


def _more(value: float, reference: float) -> str:
    ratio = value / reference
    return f"{_share(abs(ratio - 1.0))} {'larger' if ratio >= 1.0 else 'smaller'}"
