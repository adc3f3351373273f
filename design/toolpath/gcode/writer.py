"""Class that writes a one-head job's G-code part by part, keeping position and plunger state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.errors import ToolpathError
from design.toolpath.gcode.commands import Stops, join_stops, per_axis, plunger_mm_per_ul, stops
from design.toolpath.gcode.job import Gcode, GcodeOptions
from design.toolpath.gcode.marks import Context, Marks, marks_of
from design.toolpath.gcode.table import (
    JobPosition,
    Table,
    decimals_for,
    declare_position,
    dialect_of,
    place_text,
    render,
    tabulate,
)
from design.toolpath.toolpath import MoveKind, Toolpath
from firmware_profiles import Pneumatic, Printer, Syringe
from firmware_profiles.families.dialect import Dialect
from kernels.arrays import FloatArray

#: Room that the link needs on each line: a number, ``N1234567 ``, and a checksum, ``*255``.
LINK_BYTES = 13


class Writer:
    """Writes the parts of one job in their order; see `stream_gcode`.

    Parameters
    ----------
    printer : Printer
    syringe : Syringe
    place_mm : (3,) float64, mm
        From the part's frame to the printer's.
    options : GcodeOptions
    top_mm : float, mm
        Highest that the tip goes, in the part's frame.
    """

    def __init__(
        self,
        printer: Printer,
        syringe: Syringe,
        place_mm: FloatArray,
        options: GcodeOptions,
        top_mm: float,
    ) -> None:
        self._printer, self._syringe = printer, syringe
        self._place, self._options = place_mm, options
        self._path_top = top_mm + float(place_mm[2])
        cleared = min(self._path_top + options.clearance_mm, printer.z_mm.high)
        self._top = max(cleared, self._path_top)
        self._dialect = dialect_of(printer)
        self._begin: JobPosition | None = None
        self._reached: JobPosition | None = None
        self._pushed_ul = 0.0
        self._moves = 0
        self._source: int | None = None

    def write(self, toolpath: Toolpath, *, last: bool) -> Gcode:
        """Lines of the next part; the ``last`` one ends the job.

        Raises
        ------
        ToolpathError
            As `stream_gcode`.
        """
        self._check(toolpath)
        begin, reached = self._where(toolpath)
        first = reached is begin
        commands = self._stops(toolpath, first=first, last=last)
        blind = first and self._options.start_mm is None
        table, self._reached = tabulate(commands, reached, self._printer, blind=blind)
        if first:
            declares = not blind and not self._dialect.declares
            plunger = self._printer.pneumatic is None
            table = declare_position(table, begin, position=declares, plunger=plunger)
        marks = self._marks(toolpath, table, last=last)
        gcode = self._rendered(toolpath, table, marks)
        self._remember(toolpath)
        return self._framed(gcode, begin, first=first, last=last)

    def _check(self, toolpath: Toolpath) -> None:
        heads = np.unique(toolpath.tool)
        if len(heads) > 1:
            raise ToolpathError(
                f"toolpath uses heads {heads.tolist()}; {self._printer.name} has one: take a "
                "printer whose profile names heads"
            )
        self._check_height(toolpath)

    def _check_height(self, toolpath: Toolpath) -> None:
        highest = float(toolpath.end[:, 2].max()) + float(self._place[2])
        if highest > self._path_top + 1e-9:
            raise ToolpathError(
                f"{toolpath.source_kind} {int(toolpath.source[-1])} goes up to {highest:g} mm, "
                f"above the {self._path_top:g} mm that the job was begun for (top_mm)"
            )

    def _where(self, toolpath: Toolpath) -> tuple[JobPosition, JobPosition]:
        """The job's begin, and where it stands now."""
        if self._begin is None or self._reached is None:
            place = begin_of(toolpath.start[0] + self._place, self._options)
            self._begin = self._reached = JobPosition.at(place, self._printer)
        return self._begin, self._reached

    def _stops(self, toolpath: Toolpath, *, first: bool, last: bool) -> Stops:
        """Commands of a part, with the ways in and out at the job's ends."""
        printer, syringe, place, options = self._printer, self._syringe, self._place, self._options
        body = stops(toolpath, printer, syringe, place, options.flow_factor, self._pushed_ul)
        if printer.pneumatic:
            body = at_flow(body, toolpath, printer, place, options)
        parts = [body]
        if first:
            start = toolpath.start[0] + place
            parts.insert(
                0, approach_commands(begin_of(start, options), start, self._top, printer, options)
            )
        if last:
            parts.append(
                departure_commands(body.position[-1], self._top, printer, syringe, options)
            )
        return join_stops(parts)

    def _marks(self, toolpath: Toolpath, table: Table, *, last: bool) -> Marks:
        marks = marks_of(toolpath, table, Context(self._source, last))
        marks = marks.begun_by(self._dialect.comment)
        head, doses = self._printer.pneumatic, self._options.standing_doses
        if head is None:
            return marks
        return valve_lines(toolpath, table, head, marks, self._dialect, standing_doses=doses)

    def _rendered(self, toolpath: Toolpath, table: Table, marks: Marks) -> Gcode:
        digits, dialect = decimals_for(self._printer), self._dialect
        table = replace(table, code=np.where(table.code == 0, dialect.travels, table.code))
        times = (dialect.feed_decimals, dialect.dwell_decimals)
        places = (digits.x, digits.y, digits.z, digits.e, *times)
        text, longest = render(table, places, dialect.words)
        room = self._printer.max_line_bytes
        if longest > room - LINK_BYTES:
            raise ToolpathError(
                f"a G-code line of {longest} bytes leaves no room for number and checksum within "
                f"{room} bytes (profile {self._printer.name!r}: max_line_bytes); use a printer "
                "with longer lines"
            )
        source, move = (np.insert(of, marks.row, -1) for of in (table.source, table.move))
        kind = np.where(move >= 0, toolpath.kind[move], -1)
        move[move >= 0] += self._moves
        return Gcode(marks.put_into(text), source, move, kind, toolpath.source_kind)

    def _remember(self, toolpath: Toolpath) -> None:
        self._pushed_ul = float(np.cumsum(np.append(self._pushed_ul, toolpath.volume_ul))[-1])
        self._moves += len(toolpath)
        writes = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
        if len(writes):
            self._source = int(toolpath.source[writes[-1]])

    def _framed(self, gcode: Gcode, begin: JobPosition, *, first: bool, last: bool) -> Gcode:
        """Put the dialect's header before the first part, its footer behind the last."""
        known = self._options.start_mm is not None
        start = place_text(begin, self._printer) if known else None
        header = self._dialect.header(self._printer, start) if first else []
        footer = self._dialect.footer() if last else []
        around = (len(header), len(footer))
        return replace(
            gcode,
            data=_lines(header) + gcode.data + _lines(footer),
            line_source=np.pad(gcode.line_source, around, constant_values=-1),
            line_move=np.pad(gcode.line_move, around, constant_values=-1),
            line_kind=np.pad(gcode.line_kind, around, constant_values=-1),
        )


def _lines(texts: list[str]) -> bytes:
    return "".join(f"{line}\n" for line in texts).encode()


# Make the commands that travel to a toolpath's first point, and away from its last.


def begin_of(first: FloatArray, options: GcodeOptions) -> FloatArray:
    """X, Y, Z and plunger before the first command, (4,) mm.

    Made up where nobody knows: any other place than ``first`` (3,) does, it only gives the moves a
    direction.
    """
    return np.append(first - 1.0 if options.start_mm is None else options.start_mm, 0.0)


def approach_commands(
    begin: FloatArray, first: FloatArray, top: float, printer: Printer, options: GcodeOptions
) -> Stops:
    """Straight up or down to ``top``, across, and down to ``first`` (3,): three commands."""
    high = top if options.start_mm is None else max(top, float(begin[2]))
    limits = printer.max_speed_mm_s
    level = min(options.travel_speed_mm_s, limits.x, limits.y)
    rise, to = min(options.travel_speed_mm_s, limits.z), np.append(first, 0.0)
    return join_stops(
        [
            Stops.to(at_height(begin, high), rise, 0),
            Stops.to(at_height(to, high), level, 0),
            Stops.to(to, rise, 0),
        ]
    )


def departure_commands(
    last: FloatArray, top: float, printer: Printer, syringe: Syringe, options: GcodeOptions
) -> Stops:
    """Relieve the plunger at ``last`` (4,) and go straight up to ``top``: two commands."""
    per_ul = plunger_mm_per_ul(printer, syringe)
    relieved = last - [0.0, 0.0, 0.0, options.relieve_ul * per_ul]
    rise = min(options.travel_speed_mm_s, printer.max_speed_mm_s.z)
    return join_stops(
        [
            Stops.to(relieved, options.plunger_ul_s * per_ul, 1),
            Stops.to(at_height(relieved, top), rise, 0),
        ]
    )


def at_height(position: FloatArray, z_mm: float) -> FloatArray:
    """The same place, (4,), at another height."""
    moved = position.copy()
    moved[2] = z_mm
    return moved


# Adapt G-code to a pneumatic head: feed rates that suit its flow, valve commands.
#
# The pressure fixes the flow Q, so a move of length l that is to lay the volume V must take V/Q:
# its speed is Q l/V, whatever the toolpath asked for. The valve opens and closes while the head
# stands (M400, or the dialect's own wait, before each), and the head waits for the valve's delay
# after each: ink flows before the first move begins, and no more when the needle leaves. What flows
# while the valve closes is laid on the spot. Primes and retractions are left out: there is no
# plunger to relieve, a closed valve takes the pressure off.

_DWELL = 4
_TOLERANCE = 1e-9


def at_flow(
    stops: Stops, toolpath: Toolpath, printer: Printer, place_mm: FloatArray, options: GcodeOptions
) -> Stops:
    """Give each writing command the speed at which the flow lays its volume.

    Parameters
    ----------
    stops : Stops
        Of the toolpath alone.
    toolpath : Toolpath
    printer : Printer
    place_mm : (3,) float64, mm
        From the part's frame to the printer's.
    options : GcodeOptions
        The flow, the ink's speeds, and whether primes are doses.

    Raises
    ------
    ToolpathError
        Where a speed is beyond what an axis or the ink bears; names layer or vessel, and place.
    """
    flow = _flow(printer, options)
    kind = toolpath.kind[stops.move]
    writes = kind == MoveKind.WRITE
    laid = np.where(toolpath.kind == MoveKind.WRITE, toolpath.volume_ul, 0.0).cumsum()
    volume = np.diff(laid[stops.move], prepend=0.0)
    way = _written_way(stops, printer, toolpath.start[0] + place_mm)
    length = np.linalg.norm(way, axis=1)
    _refuse_dry(toolpath, stops, writes & (length > 0) & (volume <= 0))
    speed = stops.speed_mm_s.copy()
    np.divide(flow * length, volume, out=speed, where=writes & (volume > 0))
    _refuse_beyond(toolpath, printer, replace(stops, speed_mm_s=speed), way, options)
    if not options.standing_doses:
        return replace(stops, speed_mm_s=speed)
    doses = kind == MoveKind.PRIME
    return replace(
        stops,
        speed_mm_s=speed,
        code=np.where(doses, _DWELL, stops.code),
        pause_s=np.where(doses, toolpath.duration_s[stops.move], stops.pause_s),
    )


def _flow(printer: Printer, options: GcodeOptions) -> float:
    if options.flow_ul_s is None:
        raise ToolpathError(
            f"{printer.name} has a pneumatic head, and nobody said its flow (flow_ul_s, µL/s): "
            "give it, measured or foreseen (firmware_profiles.steady_flow)"
        )
    return options.flow_ul_s


def _written_way(stops: Stops, printer: Printer, first: FloatArray) -> FloatArray:
    """Way of each command as its text will say it, (n, 3): rounding is part of the length."""
    digits = decimals_for(printer)
    scale = 10.0 ** np.array([digits.x, digits.y, digits.z])
    return np.diff(np.rint(np.vstack([first, stops.position[:, :3]]) * scale), axis=0) / scale


def _of(toolpath: Toolpath, move: int) -> str:
    x, y, z = toolpath.end[move].tolist()
    number = int(toolpath.source[move])
    return f"{toolpath.source_kind} {number}, to ({x:.3f}, {y:.3f}, {z:.3f}) mm of the part"


def _refuse_dry(toolpath: Toolpath, stops: Stops, dry: NDArray[np.bool_]) -> None:
    if dry.any():
        raise ToolpathError(
            f"{_of(toolpath, int(stops.move[dry.argmax()]))} writes without ink; a pneumatic head "
            "lays ink whenever it writes: make it a travel"
        )


def _refuse_beyond(
    toolpath: Toolpath,
    printer: Printer,
    stops: Stops,
    way: FloatArray,
    options: GcodeOptions,
) -> None:
    """Speeds that an axis or the ink doesn't bear; the first of each sort is named."""
    length = np.linalg.norm(way, axis=1)
    writes = (toolpath.kind[stops.move] == MoveKind.WRITE) & (length > 0)
    share = np.divide(np.abs(way), length[:, None], out=np.zeros_like(way), where=writes[:, None])
    low, high = options.ink_speed_mm_s or (0.0, np.inf)
    limits = [
        (stops.speed_mm_s * share[:, k], 0.0, limit, f"max_speed_mm_s.{axis}")
        for k, (axis, limit) in enumerate(
            zip("xyz", per_axis(printer.max_speed_mm_s)[:3].tolist(), strict=True)
        )
    ]
    for speed, least, most, key in [
        *limits,
        (stops.speed_mm_s, low, high, "the ink's write_speed_mm_s"),
    ]:
        wrong = writes & ((speed > most * (1 + _TOLERANCE)) | (speed < least * (1 - _TOLERANCE)))
        if wrong.any():
            row = int(wrong.argmax())
            raise ToolpathError(
                f"{_of(toolpath, int(stops.move[row]))}: at {options.flow_ul_s:.4g} µL/s it must "
                f"be written at {stops.speed_mm_s[row]:.4g} mm/s; its {speed[row]:.4g} mm/s are "
                f"outside {least:g} to {most:g} mm/s ({printer.name}: {key}), in "
                f"{int(wrong.sum())} moves; change the pressure, the needle or the line's width"
            )


def valve_lines(
    toolpath: Toolpath,
    table: Table,
    head: Pneumatic,
    marks: Marks,
    dialect: Dialect,
    *,
    standing_doses: bool,
) -> Marks:
    """The valve's commands and the marks, each before its row of the table.

    The valve closes before a mark (where the job may be interrupted) and opens after it.
    """
    known = table.move >= 0
    kind = np.where(known, toolpath.kind[np.maximum(table.move, 0)], -1)
    doses = (kind == MoveKind.PRIME) & standing_doses
    flows = (kind == MoveKind.WRITE) | doses
    before, after = np.roll(flows, 1), np.roll(flows, -1)
    before[:1], after[-1:] = False, False
    interrupted = np.isin(np.arange(len(kind)), marks.row)
    opens = np.flatnonzero(flows & (~before | doses | interrupted))
    closes = np.flatnonzero(flows & (~after | doses | np.roll(interrupted, -1))) + 1
    shut = _switch(head, dialect, to_open=False)
    opened = _switch(head, dialect, to_open=True)
    lines = [
        *((row, 0, text) for row in closes.tolist() for text in shut),
        *((row, 1, text) for row, text in zip(marks.row.tolist(), marks.text, strict=True)),
        *((row, 2, text) for row in opens.tolist() for text in opened),
    ]
    lines.sort(key=lambda entry: entry[:2])
    return Marks(np.array([row for row, _, _ in lines], np.int64), [text for *_, text in lines])


def _switch(head: Pneumatic, dialect: Dialect, *, to_open: bool) -> list[str]:
    """Wait for the motors, switch, wait for the valve."""
    delay = head.opening_delay_s if to_open else head.closing_delay_s
    pause = [dialect.dwell(delay)] if delay > 0 else []
    return [dialect.waits, head.opens if to_open else head.closes, *pause]
