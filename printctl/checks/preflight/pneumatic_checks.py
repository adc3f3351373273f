"""Checks of a pneumatic head (valve, pressure, ink, drops) and of any head's writing speeds."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import (
    PRESSURE_SETTLES_S,
    Ink,
    Needle,
    Pneumatic,
    Printer,
    ProfileError,
    SteadyFlow,
    Syringe,
    steady_flow,
)
from firmware_profiles.families import family_of
from gcode.dry_run.run import DryRun
from gcode.heads import flowing_s
from gcode.program.gcode import code
from gcode.program.modal import DWELL, MOVE, SYNC
from gcode.program.valve import BETWEEN, CLOSED, OPEN, UNKNOWN, Valve, read_pressures
from printctl.checks.kinds import Kind
from printctl.checks.preflight.mounted import larger_syringe, profile_checks
from printctl.checks.set_up import Check, finding

_FEED_ROUNDING: Final = 1e-4
MOST_STANDING_S: Final = 1.0
"""Beyond a valve's delay, with the valve open on a path: a lab's own files wait 0.67 s."""
_SAME_PRESSURE: Final = 1e-4
"""Part of a pressure by which its text may round it."""
_DROP_BORES: Final = 2.0
"""A drop of two bores across stands one half bore out of a line on either side."""


def valve_checks(run: DryRun, printer: Printer) -> list[Check]:
    """Check a file's use of each valve from its begin to its end; none for a plunger."""
    if not printer.airs:
        return []
    checks = [
        none_check(
            run,
            Kind.VALVE,
            "plunger moves on a pneumatic head",
            run.program.pushed != 0,
            "the head is pneumatic (dispenser); generate the job for it, without E",
        ),
        *([_asked_to_watch(printer.airs[0])] if printer.streamed else []),
    ]
    for number, (head, valve) in enumerate(zip(printer.airs, run.valves, strict=True)):
        name = f"head {number} ({printer.heads[number].name}): " if printer.heads else ""
        found = [
            *_states(run, valve, head),
            _left_closed(run, valve, head),
            *_order(run, printer, valve, head),
            *_timing(run, printer, valve, head),
        ]
        checks += [replace(check, check=name + check.check) for check in found]
    return checks


def _states(run: DryRun, valve: Valve, head: Pneumatic) -> list[Check]:
    program = run.program
    moves = program.kind == MOVE
    rows = (
        (
            "moves before the valve is closed",
            moves & (valve.before == UNKNOWN),
            f"its state is unknown; start the job with {head.closes!r}",
        ),
        (
            "travels with the valve open",
            moves & (program.code == code("G0")) & valve.is_open,
            f"they would deposit ink; close the valve first ({head.closes!r})",
        ),
        (
            "commands that open the valve partly",
            marked(run, valve.row[valve.state == BETWEEN].tolist()),
            f"use {head.opens!r} or {head.closes!r}",
        ),
    )
    return [none_check(run, Kind.VALVE, *row) for row in rows]


def _order(run: DryRun, printer: Printer, valve: Valve, head: Pneumatic) -> list[Check]:
    """Switches that change nothing: the one between two of them is missing."""
    moved = np.cumsum(run.program.kind == MOVE)
    same = np.append(False, valve.state[1:] == valve.state[:-1])
    during = (moved[valve.row] > 0) & (moved[valve.row] < moved[-1:])
    wait = family_of(printer).dialect(printer).waits
    opening = " and ".join(repr(line) for line in (head.enables, head.opens) if line)
    return [
        none_check(
            run,
            Kind.VALVE,
            "valve opened twice",
            marked(run, valve.row[same & (valve.state == OPEN)].tolist()),
            f"the closing command is missing: add {wait} and {head.closes!r} at the end of the "
            f"previous path, or remove {opening} here",
        ),
        none_check(
            run,
            Kind.VALVE,
            "valve closed twice between first and last move",
            marked(run, valve.row[same & during & (valve.state == CLOSED)].tolist()),
            f"the opening command is missing, so this path isn't printed: add {wait} and {opening} "
            "at its start, or remove this command if there is no path",
        ),
    ]


def pressure_checks(run: DryRun, printer: Printer) -> list[Check]:
    """Check that a head writes at the profile's pressure, where the file sets it."""
    checks, every = [], read_pressures(run.others, printer)
    for number, head in enumerate(printer.airs):
        if not head.sets_pressure:
            continue
        sets = [(line, kpa) for line, of, kpa in every if of == number]
        wanted, rests = (
            printer.written_kpa(number, kpa) for kpa in (head.pressure_kpa, head.resting_kpa or 0.0)
        )
        opens = [
            (other == number, int(line), _set_before(int(line), sets))
            for other, valve in enumerate(run.valves)
            for line in run.program.line[valve.row[valve.state != CLOSED]]
        ]
        ends = int(run.program.line[-1]) + 1 if len(run.program) else 1
        wrong = [
            (line, kpa or 0.0)
            for own, line, kpa in opens
            if own and abs((kpa or 0.0) / wanted - 1.0) > _SAME_PRESSURE
        ]
        pressed = [
            line
            for own, line, kpa in (*opens, (False, ends, _set_before(ends, sets)))
            if not own and (kpa is None or abs(kpa - rests) > _SAME_PRESSURE * kpa)
        ]
        switch = run.program.line[run.valves[number].row]
        state = np.append(CLOSED, run.valves[number].state)
        during = [line for line, _ in sets if state[np.searchsorted(switch, line)] != CLOSED]
        hasty = _hasty(run, sets, [line for own, line, _ in opens if own])
        highest = max((kpa for _, kpa in sets), default=0.0)
        found = [
            Check(
                Kind.SET_PRESSURE,
                "pressure at valve opening",
                wrong[0][1] if wrong else wanted,
                wanted,
                "kPa",
                not wrong,
                f"line {wrong[0][0]}" if wrong else "",
                "set the profile's printing pressure (dispenser: pressure_kpa) before it",
            ),
            _at_no_line(
                "not at resting pressure while idle or at the end",
                pressed,
                "set the resting pressure (dispenser: resting_kpa) before it",
            ),
            Check(
                Kind.SET_PRESSURE,
                "highest pressure set",
                highest,
                wanted,
                "kPa",
                highest <= wanted * (1 + _SAME_PRESSURE),
                "",
                "exceeds the profile's printing pressure (dispenser: pressure_kpa); lower it",
            ),
            _at_no_line(
                "pressure changed with the valve open",
                during,
                "the flow would change along the path: set the pressure before opening the valve",
            ),
            replace(
                _at_no_line(
                    "valve opened before the pressure settled",
                    hasty,
                    f"wait {PRESSURE_SETTLES_S:g} s after setting it, otherwise beads start thin",
                ),
                weight="warns",
            ),
        ]
        name = f"head {number}: " if printer.heads else ""
        checks += [replace(one, check=name + one.check) for one in found]
    return checks


def _at_no_line(name: str, lines: list[int], remedy: str) -> Check:
    place = f"line {min(lines)}" if lines else ""
    return Check(Kind.SET_PRESSURE, name, len(lines), 0, "", not lines, place, remedy)


def _hasty(run: DryRun, sets: list[tuple[int, float]], opens: list[int]) -> list[int]:
    """Lines that open a valve too soon after its pressure was changed; of each change the first."""
    program, motion, found = run.program, run.executed, []
    before = [None, *(kpa for _, kpa in sets)]
    changes = [line for (line, kpa), last in zip(sets, before, strict=False) if kpa != last]
    for changed, until in pairwise([*changes, int(program.line.max(initial=0)) + 1]):
        opened = next((line for line in opens if changed < line < until), changed)
        rows = (program.line > changed) & (program.line < opened)
        within = np.isin(motion.line, program.command[rows])
        moved = float((motion.time_end - motion.time_start)[within].sum())
        stood = float(program.value[rows & (program.kind == DWELL)].sum())
        if opened > changed and moved + stood < PRESSURE_SETTLES_S - 1e-6:
            found.append(opened)
    return found


def _set_before(line: int, sets: list[tuple[int, float]]) -> float | None:
    """Return the pressure that was set last before a line, kPa."""
    return next((kpa for at, kpa in reversed(sets) if at < line), None)


def marked(run: DryRun, rows: list[int]) -> NDArray[np.bool_]:
    """Mark some of the program's rows, (n,)."""
    return np.isin(np.arange(len(run.program)), rows)


def none_check(run: DryRun, kind: Kind, name: str, where: NDArray[np.bool_], remedy: str) -> Check:
    """Check that no row of the program (n,) is marked; names the first line that is."""
    place = f"line {int(run.program.line[int(where.argmax())])}" if where.any() else ""
    return Check(kind, name, int(where.sum()), 0, "", not place, place, remedy)


def _left_closed(run: DryRun, valve: Valve, head: Pneumatic) -> Check:
    """Whether the last switch closes it; one that is never switched is refused as unknown."""
    shut = not len(valve.row) or bool(valve.state[-1] == CLOSED)
    place = "" if shut else f"line {int(run.program.line[valve.row[-1]])}"
    remedy = f"ink would keep flowing after the job; end it with {head.closes!r}"
    return Check(Kind.VALVE, "valve open at the end", int(not shut), 0, "", shut, place, remedy)


def _asked_to_watch(head: Pneumatic) -> Check:
    """What no link can do: switch a valve at a printer that takes nothing any more."""
    remedy = (
        f"cancel and pause send {head.closes!r} before the needle is lifted, and an emergency stop "
        "sends it before M112; but a halting firmware may ignore it, and a dead host or a pulled "
        "cable leaves valve and pressure unchanged: use a normally closed valve and stay near the "
        "air shut-off"
    )
    return finding(Kind.ASKED, "operator check", "emergency stop and dead host", remedy, "warns")


def _timing(run: DryRun, printer: Printer, valve: Valve, head: Pneumatic) -> list[Check]:
    """Switches while the motors may run, delays that aren't waited for, and standing while open."""
    program, dialect = run.program, family_of(printer).dialect(printer)
    moves = program.kind == MOVE
    delays = np.where(valve.state == OPEN, head.opening_delay_s, head.closing_delay_s) - 1e-9
    short = [
        row
        for row, delay_s in zip(valve.row.tolist(), delays.tolist(), strict=True)
        if moves[:row].any() and waits_s(run, row) < delay_s
    ]
    stand, limit = np.cumsum(moves), head.opening_delay_s + MOST_STANDING_S
    dwells = (program.kind == DWELL) & valve.is_open
    open_s = np.bincount(stand, np.where(dwells, program.value, 0.0), minlength=1)
    # A weighing doses standing, and writes nothing.
    long = dwells & (open_s[stand] > limit + 1e-9) & (moves & run.doses).any()
    waits = dialect.dwell(head.opening_delay_s), dialect.dwell(head.closing_delay_s)
    enables = f", for opening before {head.enables!r}" if head.enables else ""
    return [
        replace(
            none_check(
                run,
                Kind.VALVE,
                "valve switched while the head is moving",
                ~waited(run, printer) & marked(run, valve.row.tolist()),
                f"add {dialect.waits} before it{enables}",
            ),
            # Such a controller looks ahead, and switches before the path's end.
            weight="warns" if printer.streamed else "refuses",
        ),
        replace(
            none_check(
                run,
                Kind.VALVE,
                "valve switched without its delay",
                marked(run, short),
                f"add {waits[0]} after opening, {waits[1]} after closing (dispenser), otherwise "
                "beads start late and overrun",
            ),
            weight="warns",
        ),
        replace(
            none_check(
                run,
                Kind.VALVE,
                "dwells with the valve open beyond its delay + 1 s",
                long,
                f"ink would pile up in one spot; dwell for {waits[0]} at most",
            ),
            value=float(open_s[stand][long].max(initial=0.0)),
            limit=limit,
            unit="s",
        ),
    ]


def waited(run: DryRun, printer: Printer) -> NDArray[np.bool_]:
    """Whether the motors were waited for between the last move and each row, (n,)."""
    kind, at = run.program.kind, np.arange(len(run.program))
    still = np.isin(kind, (DWELL, SYNC) if printer.streamed else (SYNC,))
    last_still, last_move = (
        np.maximum.accumulate(np.where(rows, at, -1)) for rows in (still, kind == MOVE)
    )
    return np.asarray(last_still >= last_move)


def waits_s(run: DryRun, row: int) -> float:
    """Seconds of dwells between a switch and the next move; no end for the last."""
    program = run.program
    after = np.flatnonzero(program.kind[row:] == MOVE)
    if not len(after):
        return float("inf")
    until = slice(row, row + int(after[0]))
    return float(program.value[until][program.kind[until] == DWELL].sum())


def air_checks(
    run: DryRun, ink: Ink, needle: Needle, syringe: Syringe, printer: Printer
) -> list[Check]:
    """The set pressure against regulator, syringe and cells; the flow and the ink it takes."""
    head = printer.pneumatic
    if head is None:
        return []
    shear = head.pressure_kpa * 1e3 * needle.inner_mm / (4 * needle.length_mm)
    key = f"{printer.name}: dispenser, pressure_kpa"
    rows = (
        (
            Kind.PRESSURE,
            "pressure vs. regulator",
            head.pressure_kpa,
            head.max_pressure_kpa,
            "kPa",
        ),
        (
            Kind.PRESSURE,
            "pressure vs. syringe",
            head.pressure_kpa,
            syringe.max_pressure_kpa,
            "kPa",
        ),
        (
            Kind.SHEAR_STRESS,
            "shear stress at the needle wall",
            shear,
            ink.max_shear_stress_pa,
            "Pa",
        ),
    )
    limits = [
        Check(
            kind,
            name,
            value,
            limit,
            unit,
            value <= limit,
            key,
            "exceeds the maximum; lower the pressure, or use a longer or thinner needle (shear "
            "stress) or a stronger syringe (pressure)",
        )
        for kind, name, value, limit, unit in rows
        if limit is not None
    ]
    if syringe.max_pressure_kpa is None:
        limits.append(_asked(syringe, head))
    try:
        flow = steady_flow(head, ink, needle)
    except ProfileError as exc:
        return [
            *limits,
            finding(Kind.FLOW, "flow at the set pressure", key, str(exc)),
        ]
    return [
        *limits,
        *_flow(run, flow, syringe, key, head),
        _drop(flow, needle, head),
        *profile_checks(needle, ink),
    ]


def _asked(syringe: Syringe, head: Pneumatic) -> Check:
    remedy = (
        f"check that {syringe.name} withstands {head.pressure_kpa:g} kPa and set max_pressure_kpa: "
        "a glass syringe may burst, and a stopper may be ejected"
    )
    return finding(Kind.ASKED, "operator check", "syringe: max_pressure_kpa", remedy, "warns")


def _flow(
    run: DryRun, flow: SteadyFlow, syringe: Syringe, key: str, head: Pneumatic
) -> list[Check]:
    open_s = 0.0 if run.valve is None else flowing_s(run.executed, run.program, run.valve, head)
    needed = flow.ul_s * open_s + syringe.dead_volume_ul
    checks = [
        Check(
            Kind.VALVE_INK,
            f"ink for the open valve incl. {syringe.dead_volume_ul:g} µL dead volume",
            needed,
            syringe.volume_ul,
            "µL",
            needed <= syringe.volume_ul,
            "syringe: volume_ul",
            f"exceeds the volume of {syringe.name}; "
            f"{larger_syringe(needed - syringe.dead_volume_ul)} or print a smaller part",
        )
    ]
    if not flow.measured:
        checks.append(
            finding(
                Kind.FLOW,
                "flow at the set pressure",
                key,
                f"{flow.ul_s:.4g} µL/s predicted from the ink's viscosity, not measured for this "
                "ink, needle and pressure; all bead widths depend on it: measure it with `printctl "
                "calibrate weigh`",
                "warns",
            )
        )
    return checks


def _drop(flow: SteadyFlow, needle: Needle, head: Pneumatic) -> Check:
    """What flows at the end of each path while the valve closes, as a ball: (6 V/π)^(1/3)."""
    across = (6 * flow.ul_s * head.closing_delay_s / math.pi) ** (1 / 3)
    limit = _DROP_BORES * needle.inner_mm
    return Check(
        Kind.DROP,
        "drop diameter at path ends while the valve closes",
        across,
        limit,
        "mm",
        across <= limit,
        "dispenser: closing_delay_s",
        f"larger than beads of the needle bore ({needle.inner_mm:g} mm); use a faster valve or "
        "less pressure",
        "warns",
    )


def speed_checks(run: DryRun, ink: Ink, printer: Printer) -> list[Check]:
    """Speeds at which ink is written, against those at which a line of it holds together."""
    span = ink.write_speed_mm_s
    program = run.program
    before = program.before[:, :3]
    writes = run.doses & (program.kind == MOVE) & (program.target[:, :3] != before).any(axis=1)
    if span is None or not writes.any():
        return []
    speed = np.where(writes, np.linalg.norm(run.speed_mm_s[:, :3], axis=1), np.nan)
    return [
        _written(run, int(np.nanargmin(speed)), float(np.nanmin(speed)), ink, slowest=True),
        _written(run, int(np.nanargmax(speed)), float(np.nanmax(speed)), ink, slowest=False),
    ]


def _written(run: DryRun, row: int, value: float, ink: Ink, *, slowest: bool) -> Check:
    span = ink.write_speed_mm_s
    limit = value if span is None else span.low if slowest else span.high
    slack = _FEED_ROUNDING * limit
    return Check(
        Kind.WRITING_SPEED,
        "slowest extrusion move" if slowest else "fastest extrusion move",
        value,
        limit,
        "mm/s",
        value >= limit - slack if slowest else value <= limit + slack,
        f"line {int(run.program.line[row])}",
        f"a bead of {ink.name} breaks up at this speed (ink: write_speed_mm_s); change the speed",
        "refuses" if ink.calibrated else "warns",
    )
