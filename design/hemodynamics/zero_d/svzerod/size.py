"""Refuse an svZeroDSolver case with too many steps or results; compute its cycles to run."""

from __future__ import annotations

import math
from typing import Final

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
from design.hemodynamics.zero_d.svzerod.options import PLACE

MOST_STEPS: Final = 10_000_000
"""Steps of a run: about ten minutes for the smallest network."""
MOST_NUMBERS: Final = 250_000_000
"""Results kept: 2 GB."""
MOST_CYCLES: Final = 10_000
"""Cycles gone through until means stay."""


def windkessel_cycles(case: SvZeroDCase) -> int | None:
    """Return how many cycles to run; None where only the cycles' error tells.

    With Windkessels the number follows from their slowest decay (Pfaller et al. 2021, eq. 21).
    """
    error = case.options.cycle_error
    if error is None:
        return case.options.cycles
    decays = [b.values[1] * b.values[2] for b in case.blocks if b.kind == "RCR"]
    if not decays:
        return None
    return max(1, math.ceil(-max(decays) / case.period * math.log(error)))


def check_size(case: SvZeroDCase, variables: int) -> None:
    """Check a run's size before it begins.

    Parameters
    ----------
    variables : int
        Whose results are kept.

    Raises
    ------
    FlowError
        For more steps or results than the limits.
    """
    how, steps = case.options, case.options.points - 1
    periodic = windkessel_cycles(case)
    cycles = how.cycles if periodic is None else periodic
    if cycles * steps > MOST_STEPS:
        number = "number_of_cardiac_cycles"
        if periodic is not None and how.cycle_error is not None:
            number = "cycles for the Windkessels' slowest decay (use_cycle_to_cycle_error)"
        raise FlowError(
            f"{PLACE}: {cycles:,} {number} of {steps:,} steps are {cycles * steps:,} steps; the "
            f"limit is {MOST_STEPS:,}; lower one of them"
        )
    rows = steps * (cycles if how.output_all_cycles else 1) // how.output_interval + 1
    kept = rows * variables * (2 if how.output_derivative else 1)
    if kept > MOST_NUMBERS:
        raise FlowError(
            f"{PLACE}: results are {rows:,} times of {variables:,} variables, {kept:,} numbers; "
            f"the limit is {MOST_NUMBERS:,}; raise output_interval, or leave output_all_cycles out"
        )
