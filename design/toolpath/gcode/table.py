"""From commands to words: what changes is written, in whole last digits."""

from __future__ import annotations

import numpy as np

from design.errors import ToolpathError
from design.toolpath.gcode.commands import Stops, per_axis
from design.toolpath.gcode.numbers import FEED_DECIMALS, Decimals, decimals_for
from design.toolpath.gcode.render import Table
from design.toolpath.gcode.trip import Trip
from design.toolpath.toolpath import FloatArray, IntArray
from firmware_profiles import Printer

_X, _Y, _Z, _E, _F, _P = range(6)
_DWELL, _SET = 4, 92


def tabulate(trip: Trip, printer: Printer, *, declares: bool = True) -> Table:
    """Words of each command of a job.

    ``declares`` says whether G92 tells the firmware where the tip stands, where that is known.
    A command that changes nothing in the last digit is left out; positions are absolute, so the
    next one makes up for it.

    Raises
    ------
    ToolpathError
        When one move pushes more than E can hold.
    """
    digits = decimals_for(printer)
    begin = _quanta(trip.begin[None], digits)
    changed = np.diff(_quanta(trip.stops.position, digits), axis=0, prepend=begin) != 0
    if not trip.known:
        changed[0] = [False, False, True, False]
        changed[1] = [True, True, False, False]
    dwells = (trip.stops.code == _DWELL) & (np.rint(trip.stops.pause_s * 1e3) > 0)
    kept = changed.any(axis=1) | dwells
    stops, changed = trip.stops.where(kept), changed[kept]
    value = np.zeros((len(stops.code), 6), dtype=np.int64)
    given = np.zeros((len(stops.code), 6), dtype=np.bool_)
    value[:, :4], given[:, :4] = _quanta(stops.position, digits), changed
    value[:, _F] = _feeds(stops, trip.begin, printer, digits)
    moves = np.flatnonzero(stops.code != _DWELL)
    given[moves, _F] = np.diff(value[moves, _F], prepend=-1) != 0
    value[:, _P] = np.rint(stops.pause_s * 1e3).astype(np.int64)
    given[:, _P] = stops.code == _DWELL
    table = Table(stops.code, value, given, stops.source, stops.move)
    placed = trip.known and declares
    if printer.pneumatic:
        return _declared(table, begin[0], placed, plunger=False) if placed else table
    return _counted_anew(_declared(table, begin[0], placed), digits)


def place_text(trip: Trip, printer: Printer) -> tuple[str, str, str]:
    """Where the tip stands at the begin, as the moves round it: X, Y, Z."""
    digits = decimals_for(printer)
    places = (digits.x, digits.y, digits.z)
    x, y, z = (
        f"{quanta / 10**place:.{place}f}"
        for quanta, place in zip(
            _quanta(trip.begin[None], digits)[0, :3].tolist(), places, strict=True
        )
    )
    return x, y, z


def _quanta(position: FloatArray, digits: Decimals) -> IntArray:
    """Positions in their last digit, (n, 4); each rounded by itself, so nothing accumulates."""
    scale = 10.0 ** np.array([digits.x, digits.y, digits.z, digits.e])
    return np.rint(position * scale).astype(np.int64)


def _feeds(stops: Stops, begin: FloatArray, printer: Printer, digits: Decimals) -> IntArray:
    """F of each command, mm/min in its last digit, never above an axis' limit.

    A move steep in Z or rich in ink goes slower as a whole, so its path and its ink per length
    stay as they are. What counts is the way as written, which rounding may have tilted. Rounded
    down, but never to nothing.
    """
    scale = 10.0 ** np.array([digits.x, digits.y, digits.z, digits.e])
    written = np.diff(_quanta(stops.position, digits), axis=0, prepend=_quanta(begin[None], digits))
    change = np.abs(written) / scale
    length = np.linalg.norm(change[:, :3], axis=1)
    # Where only the plunger moves, F is the plunger's.
    length = np.where(length > 0, length, change[:, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = per_axis(printer.max_speed_mm_s) * length[:, None] / change
    limit[change == 0] = np.inf
    speed = np.minimum(stops.speed_mm_s, limit.min(axis=1))
    quanta = np.floor(speed * 60.0 * 10.0**FEED_DECIMALS * (1 + 1e-9))
    return np.maximum(quanta, 1).astype(np.int64)


def _declared(table: Table, begin: IntArray, known: bool, *, plunger: bool = True) -> Table:
    """Put the G92 in front that sets E to 0, and the position where it is known."""
    return _with_sets(table, np.array([0]), begin[None], position=known, plunger=plunger)


def _counted_anew(table: Table, digits: Decimals) -> Table:
    """Count E anew (G92) before float32 loses a quarter of its last digit.

    Only whole millimetres are taken away: whole motor steps on a printer with whole steps per
    mm, so that the firmware's own rounding loses nothing either.
    """
    plunger = table.value[:, _E]
    rows, bases = _rebase(plunger, digits.e_limit_quanta, 10**digits.e)
    value = table.value.copy()
    base = np.zeros(len(plunger), dtype=np.int64)
    base[rows] = np.diff(bases, prepend=0)
    value[:, _E] -= np.cumsum(base)
    shifted = Table(table.code, value, table.given, table.source, table.move)
    words = table.value[np.maximum(rows - 1, 0), :4].copy()
    words[:, _E] -= bases
    return _with_sets(shifted, rows, words, position=False)


def _rebase(plunger: IntArray, limit: int, whole: int) -> tuple[IntArray, IntArray]:
    """Rows before which E is counted anew, and what is taken away from there on."""
    rows: list[int] = []
    bases: list[int] = []
    base, row = 0, 0
    while len(over := np.flatnonzero(np.abs(plunger[row:] - base) > limit)):
        row += int(over[0])
        base = int(plunger[max(row - 1, 0)]) // whole * whole
        if abs(int(plunger[row]) - base) > limit:
            raise ToolpathError(
                f"one move pushes the plunger by {(plunger[row] - plunger[row - 1]) / whole:.3f} "
                f"mm; E holds at most {limit / whole:.3f} mm at a time in the firmware's float32; "
                "write it in several moves"
            )
        rows.append(row)
        bases.append(base)
    return np.array(rows, dtype=np.int64), np.array(bases, dtype=np.int64)


def _with_sets(
    table: Table, rows: IntArray, words: IntArray, *, position: bool, plunger: bool = True
) -> Table:
    """Insert G92 lines before ``rows`` with X, Y, Z, E of ``words`` (r, 4)."""
    value = np.pad(words, ((0, 0), (0, 2)))
    given = np.zeros((len(rows), 6), dtype=np.bool_)
    given[:, _E] = plunger
    given[:, [_X, _Y, _Z]] = position
    return Table(
        np.insert(table.code, rows, _SET),
        np.insert(table.value, rows, value, axis=0),
        np.insert(table.given, rows, given, axis=0),
        np.insert(table.source, rows, -1),
        np.insert(table.move, rows, -1),
    )
