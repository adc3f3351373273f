"""Check a printer, syringe, needle, ink or bath profile for contradictory values; list doubts.

Nothing here knows a real machine; `printctl profiles probe` asks one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_profiles.families.registry import family_of
from firmware_profiles.materials.inks_and_baths import Bath, Ink
from firmware_profiles.plates import Dish
from firmware_profiles.printers import Printer
from firmware_profiles.strict_model import Facts
from firmware_profiles.tools import Needle, Syringe

AVR_STEPS_HZ: Final = 40_000.0
"""What Marlin's stepper interrupt does on an ATmega2560 at 16 MHz, all axes together."""
SMALLEST_DOSE_UL: Final = 0.02
STEP_SHARE: Final = 0.25
"""A step should be at most this part of the smallest dose."""


@dataclass(frozen=True)
class ProfileDoubt:
    """Something wrong with a profile, or to be known of it.

    Attributes
    ----------
    key : str
    text : str
        What, value, limit, unit, remedy.
    grave : bool
        Whether the profile mustn't be used so.
    """

    key: str
    text: str
    grave: bool = True


def profile_doubts(facts: Facts, syringes: Sequence[Syringe] = ()) -> list[ProfileDoubt]:
    """All that is to be said of a profile.

    Parameters
    ----------
    facts : Facts
    syringes : sequence of Syringe
        To hold a printer's plunger against.
    """
    doubts: list[ProfileDoubt] = []
    match facts:
        case Printer():
            doubts += _printer(facts)
            for number in range(facts.head_count):
                doubts += _head(facts.of_head(number), syringes)
            doubts += _heads(facts)
        case Syringe():
            doubts += _syringe(facts)
        case Needle():
            doubts += _needle(facts)
        case Ink():
            doubts += _ink(facts)
        case Bath():
            doubts += _bath(facts)
        case Dish():
            pass
    unmeasured = ", ".join(facts.starting_values)
    if unmeasured:
        doubts.append(
            ProfileDoubt("starting_values", f"to be measured before use: {unmeasured}", False)
        )
    return doubts


def _printer(printer: Printer) -> Iterator[ProfileDoubt]:
    limit = printer.max_step_rate_hz or AVR_STEPS_HZ
    whose = "max_step_rate_hz" if printer.max_step_rate_hz else "an 8-bit board's; else say it"
    for axis in "xyze":
        rate = getattr(printer.steps_per_mm, axis) * getattr(printer.max_speed_mm_s, axis)
        if rate > limit:
            yield ProfileDoubt(
                f"max_speed_mm_s.{axis}",
                f"{getattr(printer.steps_per_mm, axis):g} steps/mm at "
                f"{getattr(printer.max_speed_mm_s, axis):g} mm/s are {rate:.0f} steps/s, above "
                f"{limit:.0f} ({whose}: max_step_rate_hz); lower the speed",
            )
    for axis in "xy":
        most = getattr(printer.max_acceleration_mm_s2, axis)
        if printer.acceleration_mm_s2 > most:
            yield ProfileDoubt(
                "acceleration_mm_s2",
                f"{printer.acceleration_mm_s2:g} mm/s² is above the {most:g} mm/s² of {axis} "
                "(max_acceleration_mm_s2); the firmware would use the lower",
                False,
            )
    if family_of(printer).cuts_long_lines and printer.max_line_bytes > printer.receive_buffer_bytes:
        yield ProfileDoubt(
            "max_line_bytes",
            f"{printer.max_line_bytes} bytes don't fit into the receive buffer of "
            f"{printer.receive_buffer_bytes} (receive_buffer_bytes); lines would be cut",
        )
    yield from _safety(printer)


def _safety(printer: Printer) -> Iterator[ProfileDoubt]:
    if not printer.streamed:
        yield ProfileDoubt(
            "firmware",
            f"{printer.firmware}: the controller's own software runs the file; what a stop "
            "switches off, and what stays on, is set up there",
            False,
        )
        return
    timed = bool(family_of(printer).timeout_code)
    if timed and printer.idle_timeout_s == 0:
        yield ProfileDoubt(
            "idle_timeout_s",
            "0 s: a dead host leaves heaters and motors on; 600 s is usual",
            False,
        )
    if not timed:
        yield ProfileDoubt(
            "firmware",
            f"{printer.firmware} has no timeout that a job can set: a dead host leaves heaters "
            "and motors on",
            False,
        )
    if "safe_state_on" not in printer.model_fields_set:
        yield ProfileDoubt(
            "safe_state_on",
            "not said: after a stop all heaters go off; name what must stay on (ink cooling, bath "
            "cooling), or write [] if nothing must",
        )
    for item in printer.safe_state_on:
        if not item.startswith(("ink", "bath")):
            yield ProfileDoubt(
                "safe_state_on",
                f"{item!r} begins with neither ink (the tool's temperature) nor bath (the bed's), "
                "so nothing would keep it on",
            )


def _head(printer: Printer, syringes: Sequence[Syringe]) -> Iterator[ProfileDoubt]:
    head = printer.pneumatic
    if head is None:
        yield from _plunger(printer, syringes)
    elif head.measured is not None and head.measured.pressure_kpa != head.pressure_kpa:
        yield ProfileDoubt(
            "dispenser",
            f"the flow was measured at {head.measured.pressure_kpa:g} kPa, and the regulator "
            f"is set to {head.pressure_kpa:g} kPa (pressure_kpa): it is foreseen from the ink's "
            "viscosity instead; measure it again",
            False,
        )


def _heads(printer: Printer) -> Iterator[ProfileDoubt]:
    """Heads that stand beside each other: what no number of one alone tells."""
    limit = printer.max_step_rate_hz or AVR_STEPS_HZ
    for number, head in enumerate(printer.heads):
        one = printer.of_head(number)
        rate = one.steps_per_mm.e * one.max_speed_mm_s.e
        if rate > limit:
            yield ProfileDoubt(
                f"heads.{number}.max_plunger_mm_s",
                f"{rate:.0f} steps/s of the plunger are above {limit:.0f} (max_step_rate_hz); "
                "lower the speed",
            )
        if not head.moves:
            yield ProfileDoubt(
                f"heads.{number}",
                f"{head.name!r} is fixed (no raises): its needle is as deep in the bath as the "
                "other's, but for offset_mm.z; preflight refuses a job in which it would drag "
                "through gel or meet a wall",
                False,
            )
    steps = {printer.of_head(number).steps_per_mm.e for number in range(printer.head_count)}
    note = family_of(printer).head_note
    if len(steps) > 1 and note:
        yield ProfileDoubt(
            "heads",
            f"their plunger_steps_per_mm differ: {note}; see that it was",
            False,
        )


def _plunger(printer: Printer, syringes: Sequence[Syringe]) -> Iterator[ProfileDoubt]:
    """Steps and stroke of the plunger in each syringe."""
    coarse = []
    for syringe in syringes:
        area = syringe.area_mm2
        step_ul = area / printer.steps_per_mm.e
        if step_ul > STEP_SHARE * SMALLEST_DOSE_UL:
            # A bead as long and as wide as the bore, d, takes π/4 d³.
            bore = (4 * step_ul / math.pi) ** (1 / 3)
            coarse.append(f"{step_ul * 1e3:.3g} nL in {syringe.name} (bores below {bore:.2f} mm)")
        stroke = syringe.volume_ul / area
        if printer.plunger_travel_mm and stroke > printer.plunger_travel_mm + 0.5:
            yield ProfileDoubt(
                "plunger_travel_mm",
                f"{syringe.name} is {stroke:.1f} mm long when full, above "
                f"{printer.plunger_travel_mm:g} mm; it can't be filled whole",
                False,
            )
    if coarse:
        yield ProfileDoubt(
            "steps_per_mm.e",
            f"one plunger step is more than a quarter of the smallest dose, {SMALLEST_DOSE_UL:g} "
            f"µL: {', '.join(coarse)}; through needles with such bores a move as long as the bore "
            "gets at most one step. Use a narrower syringe or more microsteps; printctl commission "
            "counts such moves for the parts that are mounted",
            False,
        )


def _syringe(syringe: Syringe) -> Iterator[ProfileDoubt]:
    stroke = syringe.volume_ul / syringe.area_mm2
    if not 5 <= stroke <= 200:
        yield ProfileDoubt(
            "inner_mm",
            f"{syringe.volume_ul:g} µL in a bore of {syringe.inner_mm:g} mm are {stroke:.3g} mm "
            "long; 5 to 200 mm is what syringes are: see the units",
        )
    if syringe.dead_volume_ul > 0.5 * syringe.volume_ul:
        yield ProfileDoubt(
            "dead_volume_ul",
            f"{syringe.dead_volume_ul:g} µL are more than half of {syringe.volume_ul:g} µL "
            "(volume_ul): see the units",
        )


def _needle(needle: Needle) -> Iterator[ProfileDoubt]:
    wall = (needle.outer_mm - needle.inner_mm) / 2
    if wall < 0.02:
        yield ProfileDoubt(
            "outer_mm",
            f"a wall of {wall * 1e3:.3g} µm is thinner than any needle's (20 µm); see both "
            "diameters",
        )
    if needle.length_mm < 5 * needle.inner_mm:
        yield ProfileDoubt(
            "length_mm",
            f"{needle.length_mm:g} mm is short for a bore of {needle.inner_mm:g} mm: see the units",
        )


def _ink(ink: Ink) -> Iterator[ProfileDoubt]:
    yield from _measured(ink.calibrated, ink)


def _bath(bath: Bath) -> Iterator[ProfileDoubt]:
    yield from _measured(bath.calibrated, bath)
    if bath.melt_out_c is not None and bath.max_printing_c >= bath.melt_out_c:
        yield ProfileDoubt(
            "max_printing_c",
            f"{bath.max_printing_c:g} °C isn't below melt_out_c, {bath.melt_out_c:g} °C: it would "
            "melt while it is printed in",
        )


def _measured(calibrated: bool, facts: Facts) -> Iterator[ProfileDoubt]:
    if calibrated and facts.starting_values:
        yield ProfileDoubt(
            "calibrated",
            f"true, but starting_values has {', '.join(facts.starting_values)}; take out what was "
            "measured, or say false",
        )
