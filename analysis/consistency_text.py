"""Results of `gaitd consistency` as lines of text."""

from collections.abc import Iterator

from analysis.consistency import Band, Consistency, Drifted, Gap, Offset, Plant, Rest
from observer.filter.states import STATE_NAMES


def lines(
    plant: Plant,
    found: Consistency,
    run_count: int,
    rest: Rest,
    lost: list[Gap],
    drifted: list[Drifted],
    extent: list[Offset],
) -> Iterator[str]:
    """Format all results, in the order of reading."""
    yield (
        f"Monte Carlo  {run_count} runs of {len(found.nees_over_time)} steps, both axes in motion\n"
        f"             {found.discarded_count} more discarded: noise carried the leg to its edges\n"
        f"NEES         {_in_band(found.nees)}, 8 is ideal\n"
        f"NIS          {_in_band(found.nis)}, 2 is ideal\n"
        f"whiteness    correlation of one innovation with the next {found.correlation:+.3f}\n"
        "within       1 sigma  2 sigma  3 sigma   (68.3, 95.4, 99.7 % if Gaussian)"
    )
    for name, *shares in zip(STATE_NAMES, *found.within_ratio.tolist(), strict=True):
        yield f"  {name:<23}" + "  ".join(f"{share:7.1%}" for share in shares)
    std, net = rest.estimates.std[-1], rest.estimates.net_std[-1]
    hip, slide = plant.frictions
    yield (
        "at rest      for 60 s, no patient in the machine\n"
        f"  patient, rms             {rest.patient_rms[0]:.3f} N·m, {rest.patient_rms[1]:.2f} N\n"
        f"  sigma of the split       {std[6]:.1f} N·m, {std[7]:.0f} N"
        f" (friction holds up to {hip.stribeck:g} and {slide.stribeck:g})\n"
        f"  sigma of the net effort  {net[0]:.2f} N·m, {net[1]:.1f} N"
    )
    yield "gaps         largest error of 22 gaps, in motion"
    for gap in lost:
        yield (
            f"  {1e3 * gap.duration_s:3.0f} ms    {1e3 * gap.error[0]:6.2f} mrad = "
            f"{gap.sigmas[0]:.1f} sigma, {1e3 * gap.error[1]:6.2f} mm = {gap.sigmas[1]:.1f} sigma; "
            f"sigma grew {gap.growth[0]:.0f} and {gap.growth[1]:.0f} times at least"
        )
    yield "drift        true friction levels; found by the drift monitor, empty machine in motion"
    for one in drifted:
        yield (
            f"  {one.level_ratio - 1.0:+4.0%}      hip {one.friction_error[0]:+6.2f} of "
            f"{one.true_error[0]:+5.2f} N·m, correlation {one.correlation[0]:+.2f}; slide "
            f"{one.friction_error[1]:+6.1f} of {one.true_error[1]:+5.1f} N, "
            f"{one.correlation[1]:+.2f}"
        )
    yield "offset       of the hip's encoder, from one cycle on"
    for one in extent:
        yield (
            f"  {one.offset_rad:.2f} rad   believed after {one.believed_after_cycles} cycles, "
            f"{'flagged' if one.flagged else 'NOT FLAGGED'}, valid again after "
            f"{one.valid_after_cycles}"
        )


def _in_band(band: Band) -> str:
    word = "inside" if band.inside else "OUTSIDE"
    return (
        f"{band.mean:.2f}, {word} the 95 % band of one instant {band.low:.2f}..{band.high:.2f}; "
        f"{band.inside_ratio:.0%} of the instants inside (95 % is ideal)"
    )
