"""Check a G-code job against printer, needle, ink, dish and bath before it is printed.

Goes in: a G-code file and a `SetUp`. Comes out: checks, each passed or failed with its numbers.
Begin with `set_up.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.checks.preflight.dish import (
        dish_checks,
    )
    from printctl.checks.preflight.force import force_checks, hardest_push
    from printctl.checks.preflight.gcode import gcode_checks
    from printctl.checks.preflight.heads import check_each_head, head_checks
    from printctl.checks.preflight.ink import (
        PrintTime,
        ink_use,
        temperature_checks,
        viability_checks,
        viability_facts,
        volumes,
    )
    from printctl.checks.preflight.mounted import (
        chemistry_check,
        held_check,
        syringe_checks,
    )
    from printctl.checks.preflight.set_up import Designed, file_checks
    from printctl.checks.preflight.shaft import (
        accepted_text,
        shaft_clearance,
        shaft_lines,
        written_arrays,
    )
    from printctl.checks.preflight.steps import step_checks
    from printctl.checks.preflight.wells import (
        Wells,
        compare_well_moves,
        well_arrays,
        well_checks,
    )
    from printctl.checks.set_up import (
        Budget,
        Check,
        HeadLoading,
        PlacedDish,
        SetUp,
        budget_of,
        placed_failures,
        refuse_failed,
        warnings,
    )

__all__ = [
    "Budget",
    "Check",
    "Designed",
    "HeadLoading",
    "PlacedDish",
    "PrintTime",
    "SetUp",
    "Wells",
    "accepted_text",
    "budget_of",
    "check_each_head",
    "chemistry_check",
    "compare_well_moves",
    "dish_checks",
    "file_checks",
    "force_checks",
    "gcode_checks",
    "hardest_push",
    "head_checks",
    "held_check",
    "ink_use",
    "placed_failures",
    "refuse_failed",
    "shaft_clearance",
    "shaft_lines",
    "step_checks",
    "syringe_checks",
    "temperature_checks",
    "viability_checks",
    "viability_facts",
    "volumes",
    "warnings",
    "well_arrays",
    "well_checks",
    "written_arrays",
]

__getattr__, __dir__ = on_demand(__name__)
