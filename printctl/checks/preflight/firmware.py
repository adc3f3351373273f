"""Check a job's idle timeout, and that the firmware knows the stop and monitoring commands.

A killed host can switch nothing off. Some families kill themselves, or switch heaters and motors
off, after a time without motion that a job can set (`Family.timeout`); others have nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from firmware_profiles import Printer, Syringe
from firmware_profiles.families import Family, family_of
from gcode.dry_run.run import DryRun
from gcode.program.gcode import code
from gcode.program.modal import DWELL, MOVE
from gcode.reading.line import is_known, is_known_name
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check, finding

_NAME: Final = "firmware idle timeout"


def firmware_checks(run: DryRun, printer: Printer) -> list[Check]:
    """The timeout, the safe state, and what no command can set."""
    if not printer.streamed:
        return [_run_by_hand(printer)]
    return [
        _timeout(run, printer),
        *_safe_state(printer),
        *_watched(printer),
        *_configured(run, printer),
    ]


def _run_by_hand(printer: Printer) -> Check:
    """What a host that sends nothing can't see to."""
    words = printer.file_controller.undefined_words if printer.file_controller else []
    remedy = (
        "load the file in the controller's own software; before running it, enable the axes "
        "(except one whose brake output is a valve), touch off, and check that units are mm, "
        "accelerations match the profile, and that its stop closes the valve or halts the plunger: "
        "printctl can't check this"
    )
    if words:
        remedy += (
            f"; also check that the controller defines {', '.join(words)}, which the file calls "
            "(file_controller: ends)"
        )
    return finding(
        Kind.ASKED,
        "operator check",
        f"{printer.name}: {printer.firmware}",
        remedy,
        "warns",
    )


def _safe_state(printer: Printer) -> list[Check]:
    """Whether the firmware knows the commands that a stop would send."""
    return _known(
        printer,
        list(dict.fromkeys((*printer.safe_lines, *printer.safe_state_off))),
        Kind.SAFE_STATE,
        "safe-state commands unknown to the firmware",
        "dispenser, safe_state_off",
        "cancelling would switch nothing off",
    )


def _watched(printer: Printer) -> list[Check]:
    """Whether it knows the questions that are asked while it prints."""
    return _known(
        printer,
        [watched.query for watched in printer.watch],
        Kind.WATCH,
        "monitoring queries unknown to the firmware",
        "watch",
        "nothing would be monitored, and the first query would end the print",
    )


def _known(
    printer: Printer, commands: Sequence[str], kind: Kind, check: str, key: str, else_: str
) -> list[Check]:
    if not commands:
        return []
    named = family_of(printer).grammar.named
    strange = []
    for command in commands:
        name = command.partition(" ")[0]
        known = name[1:].isdigit() and is_known(printer, name)
        if not known and not (named and is_known_name(printer, name.upper())):
            strange.append(command)
    remedy = f"{', '.join(strange)}: {else_}; correct the profile, or list them in extra_commands"
    place = f"{printer.name}: {key}"
    return [Check(kind, check, len(strange), 0, "", not strange, place, remedy)]


def _timeout(run: DryRun, printer: Printer) -> Check:
    """Whether the job sets the timeout before its first move and keeps it, above every dwell.

    Without one a job that heats is refused where the firmware has such a command.
    """
    family = family_of(printer)
    heats = any(heat.celsius > 0 for heat in run.heats)
    if not family.timeout_code:
        remedy = (
            f"{printer.firmware} has no idle timeout that a job can set: if the host dies, heaters "
            "and motors stay on until an operator intervenes; don't leave the print unattended, or "
            "set up a watchdog in the board's own configuration"
        )
        return finding(Kind.SWITCH_OFF, _NAME, f"{printer.name}: firmware", remedy, "warns")
    seconds, line = _least_timeout(run, family)
    dwell, dwells_at = _longest_dwell(run)
    if seconds <= 0:
        off = "without it" if line else "the job doesn't set it:"
        wanted = heats or (line > 0 and printer.idle_timeout_s > 0)
        return Check(
            Kind.SWITCH_OFF,
            _NAME,
            0,
            1,
            "s",
            False,
            f"line {line} disables it" if line else "before the first move",
            f"{off} if the host dies, everything stays on; start the job with "
            f"{family.timeout_example} (profile: idle_timeout_s {printer.idle_timeout_s:g})",
            "refuses" if wanted else "warns",
        )
    return Check(
        Kind.SWITCH_OFF,
        f"{_NAME} vs. longest dwell between moves",
        seconds,
        dwell,
        "s",
        seconds > dwell,
        f"line {line}" if seconds > dwell else f"line {dwells_at}, timeout of line {line}",
        "a longer dwell would halt the firmware; raise idle_timeout_s or shorten the dwell",
    )


def _longest_dwell(run: DryRun) -> tuple[float, int]:
    """Seconds of the longest dwells between two moves, and the last one's line; zeros for none.

    A firmware counts from the last block that its motors ran: dwells that follow each other, or
    have only a move to the same place or below the planner's least steps between them, are one.
    """
    program, line = run.program, run.program.line
    dwells = np.flatnonzero((program.kind == DWELL) & (program.value > 0))
    if not len(dwells):
        return 0.0, 0
    moved = (program.kind == MOVE) & np.isin(program.command, run.executed.line)
    between = np.cumsum(moved)[dwells]
    seconds = np.bincount(between, program.value[dwells])
    longest = int(seconds.argmax())
    return float(seconds[longest]), int(line[dwells[between == longest][-1]])


def _least_timeout(run: DryRun, family: Family) -> tuple[float, int]:
    """Shortest timeout in force from the first move on, s, and its line; 0 for none.

    0 stands for none at all (line 0 where it was never set) and is the least of all.
    """
    program = run.program
    moves = np.flatnonzero(program.kind == MOVE)
    first = int(program.line[moves[0]]) if len(moves) else math.inf
    timeouts = _timeouts(run, family)
    before = [at for at in timeouts if at[1] < first][-1:] or [(0.0, 0)]
    return min([*before, *(at for at in timeouts if at[1] > first)])


def _timeouts(run: DryRun, family: Family) -> list[tuple[float, int]]:
    """Each setting of the timeout, s, and its line; a question is none."""
    name, key = family.timeout_code, family.timeout_key
    if key:
        return [
            (_number(line.parameters[key]), number)
            for number, line in run.named
            if line.code == name and key in line.parameters
        ]
    program = run.program
    rows = np.flatnonzero((program.code == code(name)) & ~np.isnan(program.value))
    return list(zip(program.value[rows].tolist(), program.line[rows].tolist(), strict=True))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _configured(run: DryRun, printer: Printer) -> list[Check]:
    """Things that stand in the firmware's configuration, where nothing tells them."""
    if run.plunger_max_mm <= 0:
        return []
    family = family_of(printer)
    place, remedy = family.configuration_file, family.configuration_remedy
    if not place or (printer.heads and not family.configured_heads):
        return []
    return [finding(Kind.ASKED, "operator check", place, remedy, "warns")]


def widest_push_check(run: DryRun, printer: Printer, syringe: Syringe) -> list[Check]:
    """Tell the limit that a firmware needs which refuses to push more ink per length."""
    family = family_of(printer)
    if not family.limits_push_width:
        return []
    program = run.program
    before = program.before
    way = np.linalg.norm((program.target - before)[:, :3], axis=1)
    pushed = (program.target - before)[:, 3] * math.pi / 4 * syringe.inner_mm**2
    moves = (program.kind == MOVE) & (way > 0)
    area = np.zeros(len(program))
    np.divide(pushed, way, out=area, where=moves)
    at = int(area.argmax()) if len(area) else 0
    widest = float(area.max(initial=0.0))
    if widest <= 0:
        return []
    remedy = (
        f"max_extrude_cross_section (section extruder) must exceed {widest:.3g} mm² with "
        f"filament_diameter {syringe.inner_mm:g}; check it"
    )
    place = f"line {int(program.line[at])}, {family.configuration_file}"
    return [finding(Kind.ASKED, "operator check", place, remedy, "warns")]
