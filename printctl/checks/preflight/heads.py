"""Checks of multi-head jobs: each head by itself, raised and lowered heads, idle needles.

Looked at for every move and every head, with its tip where the profile says it stands: raised heads
are told from lowered ones by the file's own commands. What a firmware would make of the file's
changes of head is found by `gcode.heads`, whose findings refuse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Needle, Printer
from firmware_profiles.families import family_of
from gcode.dry_run.run import DryRun
from gcode.program.modal import MOVE
from kernels.arrays import FloatArray
from printctl.checks.kinds import Kind
from printctl.checks.preflight.dish import wall_gap
from printctl.checks.preflight.pneumatic_checks import marked, none_check, waited, waits_s
from printctl.checks.set_up import WALL_CLEARANCE_MM, Check, PlacedDish, finding

ABOUT_HEADS: Final = {
    "no_such_head": "non-existent heads selected",
    "head_not_chosen": "plunger moves before a head is selected",
    "plunger_not_counted": "plunger moves without G92 E after a head change",
    "offset_twice": "head offsets that would be applied twice",
    "offset_unknown": "heads selected without clearing their firmware offset",
}
"""Findings of the dry run of which none is allowed, and their names."""
_TINY_MM: Final = 1e-6
_ABOUT_MM: Final = 1.0
"""How far from what it writes a way in may begin, low as that is: a lead or a hop is shorter."""


def check_each_head(
    run: DryRun, printer: Printer, checks: Callable[[int, DryRun, Printer], Sequence[Check]]
) -> list[Check]:
    """Checks of each head that the file uses, as if it were the only one, under its name.

    Parameters
    ----------
    run : DryRun
    printer : Printer
    checks : callable
        Given a head's number, the run as that head sees it, and the printer with it alone.
    """
    all_checks: list[Check] = []
    for number in range(printer.head_count):
        own = run.program.tool == number
        if not (run.doses | (run.program.pushed != 0))[own].any():
            continue
        name = f"head {number} ({printer.heads[number].name})"
        rows = checks(number, run.of_head(number), printer.of_head(number))
        all_checks += [replace(check, check=f"{name}: {check.check}") for check in rows]
    return all_checks


def head_checks(
    run: DryRun,
    printer: Printer,
    standing: PlacedDish | None = None,
    needles: Sequence[Needle | None] = (),
) -> list[Check]:
    """Raised and lowered heads; the needles that don't write against ink, bath and wall.

    Parameters
    ----------
    run : DryRun
    printer : Printer
    standing : PlacedDish or None
        The dish and the bath in it, where they are known.
    needles : sequence of Needle or None
        Of each head, for its thickness beside the wall.
    """
    if not printer.heads:
        return []
    known = [needles[k] if k < len(needles) else None for k in range(printer.head_count)]
    return [
        *_states(run, printer),
        _lowered_into(run, printer),
        _idle_above(run, printer, standing),
        *([] if standing is None else [_idle_in_walls(run, printer, standing, known)]),
        _asked(printer),
    ]


def _states(run: DryRun, printer: Printer) -> list[Check]:
    program, heads = run.program, run.heads
    moves, dialect = program.kind == MOVE, family_of(printer).dialect(printer)
    active = np.arange(len(program)), program.tool
    rows = (
        (
            "moves before every head was raised or lowered",
            moves & ~heads.commanded.all(axis=1),
            "it is unknown which needle is down; start the file by raising or lowering every head",
        ),
        (
            "plunger moves with the head raised",
            ((program.pushed != 0) | run.doses) & heads.raised[active],
            "ink would be dispensed in air; lower the head first (heads: lowers)",
        ),
        *(
            (
                f"moves with the valve of idle head {number} open",
                moves & valve.is_open & (program.tool != number),
                f"its ink would leak; add {dialect.waits} and {printer.airs[number].closes!r} at "
                "the end of its path",
            )
            for number, valve in enumerate(run.valves)
        ),
    )
    checks = [none_check(run, Kind.HEAD_STATE, *row) for row in rows]
    switched = (np.diff(heads.raised, axis=0, append=heads.raised[-1:])).any(axis=1)
    checks.append(
        none_check(
            run,
            Kind.HEAD_STATE,
            "heads raised or lowered while moving",
            switched & ~waited(run, printer),
            f"add {dialect.waits} before it",
        )
    )
    least = max((head.moving_s for head in printer.heads if head.moves), default=0.0)
    rows_switched = np.flatnonzero(switched).tolist()
    short = [row for row in rows_switched if waits_s(run, row) < least - 1e-9]
    checks.append(
        replace(
            none_check(
                run,
                Kind.HEAD_STATE,
                "heads raised or lowered without their delay",
                marked(run, short),
                f"add {dialect.dwell(least)} after it (heads: moving_s)",
            ),
            weight="warns",
        )
    )
    return checks


def _written_top(run: DryRun) -> tuple[float, int]:
    """Highest tip that writes, and the row; minus infinity where nothing is written."""
    program = run.program
    writes = np.flatnonzero(run.doses & (program.kind == MOVE))
    if not len(writes):
        return -np.inf, -1
    heads = run.heads
    tips = program.target[writes, 2] + heads.offset_mm[program.tool[writes], 2]
    return float(tips.max()), int(writes[int(tips.argmax())])


def _lowered_into(run: DryRun, printer: Printer) -> Check:
    """Tips at the moments at which a head swings down: above all that the job writes."""
    program, heads = run.program, run.heads
    top, _ = _written_top(run)
    before = np.vstack([heads.raised[:1] * True, heads.raised[:-1]])
    worst, place = np.inf, -1
    for number in range(printer.head_count):
        for row in np.flatnonzero(before[:, number] & ~heads.raised[:, number]).tolist():
            height = float(program.target[row - 1, 2] + heads.offset_mm[number, 2])
            if height < worst:
                worst, place = height, row
    low = worst if np.isfinite(worst) else top if np.isfinite(top) else 0.0
    limit = top if np.isfinite(top) else low
    return Check(
        Kind.HEAD_STATE,
        "lowest tip at head lowering vs. top of the print",
        low,
        limit,
        "mm",
        low >= limit - _TINY_MM,
        f"line {int(program.line[place])}" if place >= 0 else "",
        "the needle would hit the print; change heads at a greater height",
    )


def _idle_above(run: DryRun, printer: Printer, standing: PlacedDish | None) -> Check:
    """The needle that doesn't write, against what it would drag through: bath, or ink.

    Between what one head writes and what the next does, neither may go across lower, but about the
    places that it writes.
    """
    top, _ = _written_top(run)
    what = "the print"
    limit = top
    if standing is not None and standing.bath_mm is not None:
        surface = standing.floor_mm + standing.bath_mm
        if surface > limit:
            limit, what = surface, "the bath surface"
    worst, row, whose = np.inf, -1, 0
    for number in range(printer.head_count):
        tips = run.heads.tips(run.program, number)
        idle = run.program.tool != number
        if run.heads.axis_mm is not None:
            idle &= _nears(tips)
        idle |= _changes(run) & _comes(tips, run.doses & (run.program.tool == number))
        idle &= run.program.kind == MOVE
        height = np.where(idle, tips[:, :, 2].min(axis=1), np.inf)
        if len(height) and float(height.min()) < worst:
            worst, row, whose = float(height.min()), int(height.argmin()), number
    limit = limit if np.isfinite(limit) else worst if np.isfinite(worst) else 0.0
    value = worst if np.isfinite(worst) else limit
    axis = printer.heads[whose].z_axis
    remedy = f"raise {axis} before that" if axis else "raise it further (raised_mm, offset_mm)"
    remedy += "" if limit == top else ", or fill less"
    return Check(
        Kind.IDLE_HEAD,
        f"lowest idle tip vs. {what}",
        value,
        limit,
        "mm",
        value >= limit - _TINY_MM,
        f"line {int(run.program.line[row])}" if row >= 0 else "",
        f"the needle of head {whose} ({printer.heads[whose].name}) would drag through the gel "
        f"while idle; {remedy}",
    )


def _changes(run: DryRun) -> NDArray[np.bool_]:
    """Rows before the first head writes, between two heads, and after the last, (n,)."""
    at = np.flatnonzero(run.doses)
    of = np.concatenate([[-1], run.program.tool[at], [-1]])
    gap = np.searchsorted(at, np.arange(len(run.program)))
    return np.asarray(~run.doses & (of[gap] != of[gap + 1]))


def _comes(tips: FloatArray, writes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether a tip goes across from or to a place away from all that it writes, (n,)."""
    ends = tips[:, :, :2]
    across = (ends[:, 0] != ends[:, 1]).any(axis=1)
    if not writes.any():
        return np.asarray(across)
    written = ends[writes].reshape(-1, 2)
    low, high = written.min(axis=0) - _ABOUT_MM, written.max(axis=0) + _ABOUT_MM
    return np.asarray(across & ((ends < low) | (ends > high)).any(axis=(1, 2)))


def _nears(tips: FloatArray) -> NDArray[np.bool_]:
    """Whether a tip goes across or down, (n,): straight up it meets nothing."""
    step = tips[:, 1] - tips[:, 0]
    nears: NDArray[np.bool_] = (step[:, :2] != 0).any(axis=1) | (step[:, 2] < 0)
    return nears


def _idle_in_walls(
    run: DryRun, printer: Printer, standing: PlacedDish, needles: Sequence[Needle | None]
) -> Check:
    """The needle that doesn't write, against the dish's wall: above it, or clear of it inside."""
    worst, row, whose = np.inf, -1, 0
    for number in range(printer.head_count):
        needle, tips = needles[number], run.heads.tips(run.program, number)
        gap = wall_gap(
            tips,
            _nears(tips) & (run.program.kind == MOVE) & (run.program.tool != number),
            standing,
            0.0 if needle is None else needle.outer_mm,
        )
        if len(gap) and float(gap.min()) < worst:
            worst, row, whose = float(gap.min()), int(gap.argmin()), number
    value = worst if np.isfinite(worst) else standing.dish.inner_x_mm / 2
    return Check(
        Kind.IDLE_HEAD,
        "idle needle to dish wall",
        value,
        WALL_CLEARANCE_MM,
        "mm",
        value >= WALL_CLEARANCE_MM,
        f"line {int(run.program.line[row])}" if row >= 0 else "",
        f"the needle of head {whose} ({printer.heads[whose].name}) would hit the wall of "
        f"{standing.dish.name} while another head prints; raise it above the wall (raised_mm), or "
        "use a lower dish",
    )


def _asked(printer: Printer) -> Check:
    """What no file can tell: whether the offsets are those of today's needles."""
    offsets = ", ".join(
        f"head {number}: {head.offset_mm.x:g}, {head.offset_mm.y:g}, {head.offset_mm.z:g} mm"
        for number, head in enumerate(printer.heads)
        if number
    )
    remedy = (
        f"check that the needles are mounted as in the profile ({offsets}): touch off both at the "
        "same point after every needle change (`printctl calibrate offset`)"
    )
    return finding(Kind.ASKED, "operator check", f"{printer.name}: heads", remedy, "warns")
