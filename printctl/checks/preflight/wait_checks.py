"""Find a job's first temperature wait that may never end.

No profile knows of a cooler. A room is taken to be between 15 and 30 °C: what must cool below 30 °C
may never get there, and what must warm up without a target may not either. M109 and M190 with S
wait for warming alone, but on some families (`GateFacts.awaits_cooling`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun
from sim.gcode.reading import GcodeLine

COLDEST_ROOM_C: Final = 15.0
WARMEST_ROOM_C: Final = 30.0
_SETS: Final = {
    **dict.fromkeys(("M104", "M109"), "extruder"),
    **dict.fromkeys(("M140", "M190"), "heater_bed"),
    **dict.fromkeys(("M141", "M191"), "chamber"),
}
_WAITS: Final = ("M109", "M190", "M191")


def wait_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first wait that may never end; none where all end."""
    if not printer.streamed:
        return []
    targets: dict[str, float] = {}
    for number, line in run.others:
        failed = next(_endless(line, targets, printer), None)
        if failed is not None:
            value, limit, why = failed
            name = "wait for a temperature that may never come"
            return [Check(name, value, limit, "°C", False, f"line {number}", why)]
    return []


def _endless(
    line: GcodeLine, targets: dict[str, float], printer: Printer
) -> Iterator[tuple[float, float, str]]:
    """Temperature, limit and reason of a wait that may not end; ``targets`` follow the line."""
    meaning = meanings().get(line.code)
    if line.code in _SETS:
        yield from _by_code(line, targets, printer)
    elif meaning is Meaning.HEATS:
        target = _number(line, "TARGET")
        targets[line.parameters.get("HEATER", "")] = 0.0 if target is None else target
    elif meaning is Meaning.AWAITS:
        yield from _by_name(line, targets)


def _by_code(
    line: GcodeLine, targets: dict[str, float], printer: Printer
) -> Iterator[tuple[float, float, str]]:
    head = int(line.number("T") or 0)
    kept, given = line.number("R"), line.number("S")
    target = given if given is not None else kept
    if target is None:
        return
    targets[_SETS[line.code] + (f"{head}" if head else "")] = target
    if line.code not in _WAITS:
        return
    cools = line.code in family_of(printer).gate.awaits_cooling and target > 0
    coldest = COLDEST_ROOM_C if line.code == "M191" else 0.0
    if target < (WARMEST_ROOM_C if kept is not None or cools else coldest):
        yield _too_cold(line, target)


def _by_name(line: GcodeLine, targets: dict[str, float]) -> Iterator[tuple[float, float, str]]:
    target = targets.get(line.parameters.get("SENSOR", ""), 0.0)
    least, most = _number(line, "MINIMUM"), _number(line, "MAXIMUM")
    if most is not None and most < max(WARMEST_ROOM_C, target):
        if most < WARMEST_ROOM_C:
            yield _too_cold(line, most)
        else:
            yield most, target, f"the job's target is {target:g} °C; wait for that, or lower it"
    if least is not None and least > target:
        yield (
            least,
            target,
            f"the job sets no target of {least:g} °C or more for this heater before; set one "
            "(SET_HEATER_TEMPERATURE, M104, M140), or take the wait out",
        )


def _too_cold(line: GcodeLine, celsius: float) -> tuple[float, float, str]:
    return (
        celsius,
        WARMEST_ROOM_C,
        f"{line.code} waits until it is as cold as {celsius:g} °C, and heaters cool nothing below "
        f"a room of {COLDEST_ROOM_C:g} to {WARMEST_ROOM_C:g} °C; cool before the start and take "
        "the wait out",
    )


def _number(line: GcodeLine, key: str) -> float | None:
    try:
        return float(line.parameters[key])
    except (KeyError, ValueError):
        return None
