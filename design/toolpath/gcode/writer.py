"""Write a job's G-code part by part, for one head or several: tip offsets, changes of head.

The toolpath says which head makes each move; its places are the tip's. What is written is the
carriage's place, the tip's less the head's offset (`firmware_profiles.Head.offset_mm`): the header
tells the firmware to add none, since an offset that is counted twice drives a needle into the dish.

A change of head is always the same: relieve the plunger where the toolpath hasn't, straight up
until every tip, lowered ones too, is above all that the job writes (and above the dish's wall,
`safe_z_mm`); there wait, raise the old head, choose the new one, count E from where its own plunger
stands, lower it; across, straight down to where its first move begins, prime. The toolpath's own
travels of the new head before that move are left out. A ``;RELOAD`` mark stands where the old head
is up and relieved: nothing presses in any syringe there. Where each head has a vertical axis of its
own, the one that is left stays up there; where the file sets pressures, it gets its resting one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np

from design.errors import ToolpathError
from design.toolpath.gcode.commands import (
    TRAVEL,
    WITH_PLUNGER,
    MachineMoves,
    machine_moves,
    plunger_mm_per_ul,
)
from design.toolpath.gcode.job import Gcode, GcodeOptions, HeadLoad
from design.toolpath.gcode.marks import Marks, in_order, marks_of
from design.toolpath.gcode.pneumatic import at_flow, valve_lines
from design.toolpath.gcode.table import (
    E_WORD,
    JobPosition,
    Table,
    counted_from,
    decimals_for,
    declare_height,
    declare_position,
    dialect_of,
    place_text,
    render,
    tabulate,
)
from design.toolpath.toolpath import MoveKind, Toolpath
from firmware_profiles import PRESSURE_SETTLES_S, Head, Printer, Syringe
from firmware_profiles.families.dialect import Dialect
from kernels.arrays import FloatArray, IntArray

LINK_BYTES: Final = len("N1234567 ") + len("*255")
"""What the link adds to each line: a number and a checksum."""
ROUNDING_MM: Final = 1e-9


@dataclass
class HeadState:
    """One head, and how far its plunger has come."""

    number: int
    printer: Printer  # as if it were the only one (`Printer.of_head`)
    load: HeadLoad
    head: Head | None  # how it is chosen, raised and lowered; None for a printer of one head
    dialect: Dialect
    pushed_ul: float = 0.0  # µL, what its toolpath has pushed
    quantum: int = 0  # its plunger's travel as written
    base: int = 0  # what E's counting anew has taken off it
    relieved: bool = True  # nothing presses: it has pushed nothing yet, or was relieved since
    owed_ul: float = 0.0  # µL, relief put in here, to be primed when the head comes back
    height: int = 0  # its own vertical axis' place as written

    @property
    def offset(self) -> FloatArray:
        """Of its tip from the first head's, (3,), mm."""
        return np.zeros(3) if self.head is None else np.array(self.head.offset_mm.mm)

    @property
    def per_ul(self) -> float:
        """Plunger travel per volume, mm/µL."""
        return plunger_mm_per_ul(self.printer, self.load.syringe)

    @property
    def plunger_mm(self) -> float:
        """Where its plunger stands, from the job's begin."""
        return self.pushed_ul * self.per_ul / self.load.flow_factor - self.owed_ul * self.per_ul

    def select(self) -> list[str]:
        """Command that chooses it; none where its valve does."""
        return [] if self.head is None or self.head.select is None else [self.head.select]

    def pressure(self, *, writes: bool) -> list[str]:
        """Lines that set its writing pressure and wait for it, or set its resting pressure."""
        air = self.printer.pneumatic
        if air is None or air.resting_kpa is None:
            return []
        if not writes:
            return self.printer.pressure_lines(0, air.resting_kpa)
        settles = self.dialect.dwell(PRESSURE_SETTLES_S)
        return [*self.printer.pressure_lines(0, air.pressure_kpa), settles]

    def moved(self, *, to_raise: bool) -> list[str]:
        """Raise or lower it with the motors standing, and wait; nothing where it is fixed."""
        if self.head is None:
            return []
        command = self.head.raises if to_raise else self.head.lowers
        if command is None:
            return [self.dialect.waits] if to_raise else []
        wait = [self.dialect.dwell(self.head.moving_s)] if self.head.moving_s > 0 else []
        return [self.dialect.waits, command, *wait]

    def reached(self, at: JobPosition) -> JobPosition:
        """``at``, with this head's plunger and vertical axis in place of another's."""
        quanta = at.quanta.copy()
        quanta[E_WORD] = self.quantum
        if self.own_axis:
            quanta[2] = self.height
        return replace(at, quanta=quanta, base=self.base)

    @property
    def own_axis(self) -> bool:
        """Whether it has a vertical axis of its own."""
        return self.head is not None and self.head.z_axis is not None


@dataclass
class _Lines:
    """A part's table rows as they gather, and the commands between them that are no rows."""

    tables: list[Table] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    rows: int = 0

    def add(self, table: Table) -> None:
        self.tables.append(table)
        self.rows += len(table.code)

    def insert(self, *texts: str) -> None:
        self.row += [self.rows] * len(texts)
        self.text += texts


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

    Raises
    ------
    ToolpathError
        When the options don't say what each of several heads holds, or the axis ends too low for a
        change of head.
    """

    def __init__(
        self,
        printer: Printer,
        syringe: Syringe,
        place_mm: FloatArray,
        options: GcodeOptions,
        top_mm: float,
    ) -> None:
        self._place, self._options, self._syringe = place_mm, options, syringe
        self._path_top = top_mm + float(place_mm[2])
        self._dialect = dialect_of(printer)
        self._heads = _heads(printer, syringe, options, self._dialect)
        # The finest plunger's digits for all, so that one job has one writing of E.
        finest = max(one.printer.steps_per_mm.e for one in self._heads)
        steps = printer.steps_per_mm.model_copy(update={"e": finest})
        self._printer = printer.model_copy(update={"steps_per_mm": steps})
        self._top = self._travel_height(printer)
        self._active = self._heads[0]
        self._begin: JobPosition | None = None
        self._reached: JobPosition
        self._moves = 0
        self._source: int | None = None

    def _travel_height(self, printer: Printer) -> float:
        """Return the height of ways in, out and between heads; all lowered tips clear the part."""
        clear = self._path_top + self._options.clearance_mm
        if not printer.heads:
            return max(min(clear, printer.z_mm.high), self._path_top)
        safe = max(clear, self._options.safe_z_mm or -np.inf)
        lowest = min(float(one.offset[2]) for one in self._heads)
        if safe - lowest > printer.z_mm.high + ROUNDING_MM:
            raise ToolpathError(
                f"heads are changed with the carriage at {safe - lowest:g} mm, so that every tip "
                f"is above {safe:g} mm; {printer.name} ends at {printer.z_mm.high:g} mm (z_mm); "
                "set the part lower, or take a lower dish"
            )
        return safe - lowest

    def write(self, toolpath: Toolpath, *, last: bool) -> Gcode:
        """Write the next part; the ``last`` one ends the job.

        Raises
        ------
        ToolpathError
            As `stream_gcode`.
        """
        self._check(toolpath)
        first, lines = self._begin is None, _Lines()
        runs = self._runs(toolpath, chosen=not first)
        if first:
            self._begin = self._set_out(toolpath, runs[0], lines)
        for number, rows in runs:
            if number != self._active.number:
                self._change(self._heads[number], toolpath.start[rows[0]], lines)
            self._write_run(toolpath, rows, lines)
        if last:
            self._leave(lines)
            lines.insert(*self._active.pressure(writes=False))
        gcode = self._rendered(toolpath, lines, last=last)
        self._moves += len(toolpath)
        writes = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
        if len(writes):
            self._source = int(toolpath.source[writes[-1]])
        return self._framed(gcode, first=first, last=last)

    def _check(self, toolpath: Toolpath) -> None:
        tools = np.unique(toolpath.tool)
        if not self._printer.heads and len(tools) > 1:
            raise ToolpathError(
                f"toolpath uses heads {tools.tolist()}; {self._printer.name} has one: take a "
                "printer whose profile names heads"
            )
        unknown = np.setdiff1d(tools, np.arange(len(self._heads)))
        if self._printer.heads and len(unknown):
            raise ToolpathError(
                f"toolpath uses head {int(unknown[0])}; {self._printer.name} has "
                f"{len(self._heads)} (heads)"
            )
        highest = float(toolpath.end[:, 2].max()) + float(self._place[2])
        if highest > self._path_top + ROUNDING_MM:
            raise ToolpathError(
                f"{toolpath.source_kind} {int(toolpath.source[-1])} goes up to {highest:g} mm, "
                f"above the {self._path_top:g} mm that the job was begun for (top_mm)"
            )

    def _runs(self, toolpath: Toolpath, *, chosen: bool) -> list[tuple[int, IntArray]]:
        """Heads in turn, with the rows that each writes."""
        if not self._printer.heads:
            return [(0, np.arange(len(toolpath)))]
        return list(_runs_of_heads(toolpath, self._active.number if chosen else None))

    # -- parts of a job

    def _set_out(self, toolpath: Toolpath, run: tuple[int, IntArray], lines: _Lines) -> JobPosition:
        """Go to the first point and return where the job begins.

        All but the first head are raised; the first is lowered, as it was touched off so. The way
        goes straight up or down, across, and down where the first head writes first; a change of
        head goes down itself. Where the tip's place is unknown, one beside the first point gives
        the moves a direction.
        """
        number, rows = run
        options = self._options
        to = toolpath.start[rows[0]] + self._place - self._heads[number].offset
        blind = options.start_mm is None
        start = np.append(to - 1.0 if options.start_mm is None else options.start_mm, 0.0)
        begin = JobPosition.at(start, self._printer)
        first = self._heads[0]
        for one in self._heads:
            lines.insert(*one.pressure(writes=one is first))
        for one in self._heads[1:]:
            if not one.own_axis:
                lines.insert(*one.moved(to_raise=True))
        lines.insert(*first.select(), *first.moved(to_raise=False))
        high = self._top if blind else max(self._top, float(start[2]))
        end = np.append(to, 0.0)
        way = [self._rise(start, high, first), self._across(end, high, first)]
        if number == 0:
            way.append(self._rise(end, end[2], first))
        table, self._reached = tabulate(MachineMoves.joined(way), begin, self._printer, blind=blind)
        declares = not blind and not self._dialect.declares
        plunger = self._printer.pneumatic is None
        declared = declare_position(table, begin, position=declares, plunger=plunger)
        others = [one for one in self._heads[1:] if one.own_axis]
        first_rows = np.arange(len(declared.code)) < len(declared.code) - len(table.code)
        lines.add(declared.where(first_rows))
        if declares:
            for one in others:
                lines.add(declare_height(begin).of(one.number))
        if others:  # no axis is above the height of changes
            self._top = high
        for one in others:
            low = JobPosition.at(_with(start, 2, high - 1.0), self._printer) if blind else begin
            up, reached = tabulate(self._rise(start, high, one), low, self._printer)
            lines.add(up.of(one.number))
            one.height = int(reached.quanta[2])
        lines.add(declared.where(~first_rows))
        first.height = int(self._reached.quanta[2])
        return begin

    def _change(self, new: HeadState, first_mm: FloatArray, lines: _Lines) -> None:
        """Leave the head in use, take ``new``, and go to where its first move begins."""
        self._leave(lines)
        old, self._active = self._active, new
        reload = [f"{self._dialect.comment}RELOAD"] if old.pushed_ul else []
        lines.insert(*reload, *old.moved(to_raise=True), *new.select())
        lines.insert(*old.pressure(writes=False), *new.pressure(writes=True))
        at = new.reached(self._reached)
        if self._printer.pneumatic is None:
            table, at = counted_from(at, self._printer)
            lines.add(table)
        lines.insert(*new.moved(to_raise=False))
        to = np.append(first_mm + self._place - new.offset, new.plunger_mm)
        way = [self._across(to, self._top, new), self._rise(to, to[2], new)]
        if new.owed_ul:
            primed = to + [0.0, 0.0, 0.0, new.owed_ul * new.per_ul]
            way.append(MachineMoves.to(primed, new.load.plunger_ul_s * new.per_ul, WITH_PLUNGER))
            new.owed_ul = 0.0
        self._add(MachineMoves.joined(way), at, lines)

    def _write_run(self, toolpath: Toolpath, rows: IntArray, lines: _Lines) -> None:
        """Add moves of the head in use."""
        one, part = self._active, toolpath
        if len(rows) < len(toolpath):
            part = toolpath.where(rows)
        place, load = self._place - one.offset, one.load
        body = machine_moves(
            part, one.printer, load.syringe, place, load.flow_factor, one.pushed_ul
        )
        if self._printer.pneumatic:
            doses = self._options.standing_doses
            body = at_flow(body, part, one.printer, place, load, standing_doses=doses)
        self._add(replace(body, move=rows[body.move]), one.reached(self._reached), lines)
        one.pushed_ul = float(np.cumsum(np.append(one.pushed_ul, part.volume_ul))[-1])
        pushes = np.flatnonzero(part.volume_ul)
        if one.head is None:  # a job of one head always relieves at its end
            one.relieved = False
        elif len(pushes):
            one.relieved = bool(part.kind[pushes[-1]] == MoveKind.RETRACT)

    def _leave(self, lines: _Lines) -> None:
        """Relieve the plunger, where it presses, and go straight up."""
        one = self._active
        at = _with(self._reached.position(self._printer), E_WORD, one.plunger_mm)
        way: list[MachineMoves] = []
        if not one.relieved and one.load.relieve_ul > 0:
            one.owed_ul, one.relieved = one.load.relieve_ul, True
            at = _with(at, E_WORD, one.plunger_mm)
            way.append(MachineMoves.to(at, one.load.plunger_ul_s * one.per_ul, WITH_PLUNGER))
        way.append(self._rise(at, self._top, one))
        self._add(MachineMoves.joined(way), one.reached(self._reached), lines)

    def _rise(self, place: FloatArray, z_mm: float, one: HeadState) -> MachineMoves:
        """Straight up or down at a place, (4,)."""
        speed = min(self._options.travel_speed_mm_s, one.printer.max_speed_mm_s.z)
        return MachineMoves.to(_with(place, 2, z_mm), speed, TRAVEL)

    def _across(self, place: FloatArray, z_mm: float, one: HeadState) -> MachineMoves:
        """Level, to above a place, (4,)."""
        limits = one.printer.max_speed_mm_s
        speed = min(self._options.travel_speed_mm_s, limits.x, limits.y)
        return MachineMoves.to(_with(place, 2, z_mm), speed, TRAVEL)

    def _add(self, commands: MachineMoves, at: JobPosition, lines: _Lines) -> None:
        """Add rows of the head in use, whose plunger's limits hold for them."""
        one = self._active
        own = self._printer.model_copy(update={"max_speed_mm_s": one.printer.max_speed_mm_s})
        table, self._reached = tabulate(commands, at, own)
        lines.add(table.of(one.number))
        one.quantum, one.base = int(self._reached.quanta[E_WORD]), self._reached.base
        one.height = int(self._reached.quanta[2])

    # -- text

    def _rendered(self, toolpath: Toolpath, lines: _Lines, *, last: bool) -> Gcode:
        dialect, table = self._dialect, Table.joined(lines.tables)
        marks = self._with_marks(toolpath, table, lines, last=last)
        digits = decimals_for(self._printer)
        table = replace(table, code=np.where(table.code == TRAVEL, dialect.travels, table.code))
        times = (dialect.feed_decimals, dialect.dwell_decimals)
        places = (digits.x, digits.y, digits.z, digits.e, *times)
        text, longest = render(table, places, [*map(dialect.words_of, self._printer.z_axes)])
        most = self._printer.max_line_bytes
        if longest > most - LINK_BYTES:
            raise ToolpathError(
                f"a G-code line of {longest} bytes leaves no room for number and checksum within "
                f"{most} bytes (profile {self._printer.name!r}: max_line_bytes); use a printer "
                "with longer lines"
            )
        source, move = (np.insert(of, marks.row, -1) for of in (table.source, table.move))
        kind = np.where(move >= 0, toolpath.kind[move], -1)
        move[move >= 0] += self._moves
        return Gcode(marks.put_into(text), source, move, kind, toolpath.source_kind)

    def _with_marks(self, toolpath: Toolpath, table: Table, lines: _Lines, *, last: bool) -> Marks:
        """Return all lines that are no rows; marks come before the lines of a change of head."""
        marks = marks_of(toolpath, table, self._source, last=last, comment=self._dialect.comment)
        marks = in_order(marks, Marks(np.array(lines.row, np.int64), lines.text))
        airs, doses = self._printer.airs, self._options.standing_doses
        if not airs:
            return marks
        return valve_lines(toolpath, table, airs, marks, self._dialect, standing_doses=doses)

    def _framed(self, gcode: Gcode, *, first: bool, last: bool) -> Gcode:
        """Put the dialect's header before the first part, its footer behind the last."""
        header, footer = b"", b""
        if first and self._begin is not None:
            known = self._options.start_mm is not None
            start = place_text(self._begin, self._printer) if known else None
            remarks = [f"{self._dialect.comment} {line}" for line in self._options.header]
            header = _text_of([*remarks, *self._dialect.header(self._printer, start)])
        if last:
            footer = _text_of(self._dialect.footer())
        around = (header.count(b"\n"), footer.count(b"\n"))
        return replace(
            gcode,
            data=header + gcode.data + footer,
            line_source=np.pad(gcode.line_source, around, constant_values=-1),
            line_move=np.pad(gcode.line_move, around, constant_values=-1),
            line_kind=np.pad(gcode.line_kind, around, constant_values=-1),
        )


def _heads(
    printer: Printer, syringe: Syringe, options: GcodeOptions, dialect: Dialect
) -> list[HeadState]:
    """Return each head with what it holds: the same in all, where the options name none."""
    names = [name.name for name in fields(HeadLoad) if name.name != "syringe"]
    load = HeadLoad(syringe, **{name: getattr(options, name) for name in names})
    if not printer.heads:
        return [HeadState(0, printer, load, None, dialect)]
    loads = options.heads or (load,) * printer.head_count
    if len(loads) != printer.head_count:
        raise ToolpathError(
            f"{printer.name} has {printer.head_count} heads, and {len(loads)} are said to "
            "hold something (options: heads); say it of each"
        )
    return [
        HeadState(number, printer.of_head(number), own, head, dialect)
        for number, (head, own) in enumerate(zip(printer.heads, loads, strict=True))
    ]


def _runs_of_heads(toolpath: Toolpath, active: int | None) -> Iterator[tuple[int, IntArray]]:
    """Rows of each head in turn, without the travels that only lead to a new head's first move.

    A travel alone is no reason to change: one that is another head's is made by the head in use,
    unless that other head's first move follows it.
    """
    works = toolpath.kind != MoveKind.TRAVEL
    kept: list[int] = []
    leading: list[int] = []
    for row, (tool, work) in enumerate(zip(toolpath.tool.tolist(), works.tolist(), strict=True)):
        if active is None:
            active = tool
        if tool == active:
            kept += [*leading, row]
        elif work:
            if kept:
                yield active, np.array(kept, dtype=np.int64)
            kept, active = [row], tool
        leading = [*leading, row] if tool != active else []
    if active is not None and kept + leading:
        yield active, np.array(kept + leading, dtype=np.int64)


def _with(position: FloatArray, axis: int, value_mm: float) -> FloatArray:
    """Return the place (4,) with another value of one axis."""
    moved = position.copy()
    moved[axis] = value_mm
    return moved


def _text_of(lines: list[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()
