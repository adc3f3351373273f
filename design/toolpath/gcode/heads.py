"""Write a job's G-code for a printer with several heads: tip offsets, changes of head.

The toolpath says which head makes each move; its places are the tip's. What is written is the
carriage's place, the tip's less the head's offset (`firmware_profiles.Head.offset_mm`): the header
tells the firmware to add none, since an offset that is counted twice drives a needle into the dish.

A change is always the same: relieve the plunger where the toolpath hasn't, straight up until every
tip, lowered ones too, is above all that the job writes (and above the dish's wall, `safe_z_mm`);
there wait, raise the old head, choose the new one, count E from where its own plunger stands, lower
it; across, straight down to where its first move begins, prime. The toolpath's own travels of the
new head before that move are left out. A ``;RELOAD`` mark stands where the old head is up and
relieved: nothing presses in any syringe there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from design.errors import ToolpathError
from design.toolpath.gcode.commands import Stops, join_stops, plunger_mm_per_ul, stops
from design.toolpath.gcode.job import Gcode, GcodeOptions, HeadLoad
from design.toolpath.gcode.marks import Context, Marks, marks_of
from design.toolpath.gcode.table import JobPosition, Table, counted_from, declare_position, tabulate
from design.toolpath.gcode.writer import Writer, approach_commands, at_height, begin_of
from design.toolpath.toolpath import MoveKind, Toolpath
from firmware_profiles import Head, Printer, Syringe
from kernels.arrays import FloatArray, IntArray

_E = 3


@dataclass
class IdleHead:
    """One head between two runs of its moves.

    Attributes
    ----------
    number : int
    head : Head
    printer : Printer
        As if it were the only one (`Printer.of_head`).
    load : HeadLoad
    pushed_ul : float, µL
        What its toolpath has pushed.
    quantum, base : int
        Its plunger's travel as written, and what E's counting anew has taken off it.
    relieved : bool
        Whether nothing presses: it has pushed nothing yet, or was relieved since.
    owed_ul : float, µL
        Relief that the writer put in itself, to be primed when the head comes back.
    """

    number: int
    head: Head
    printer: Printer
    load: HeadLoad
    pushed_ul: float = 0.0
    quantum: int = 0
    base: int = 0
    relieved: bool = True
    owed_ul: float = 0.0

    @property
    def offset(self) -> FloatArray:
        """Of its tip from the first head's, (3,), mm."""
        return np.array(self.head.offset_mm.mm)

    @property
    def per_ul(self) -> float:
        """Plunger travel per volume, mm/µL."""
        return plunger_mm_per_ul(self.printer, self.load.syringe)

    @property
    def plunger_mm(self) -> float:
        """Where its plunger stands, from the job's begin."""
        return self.pushed_ul * self.per_ul / self.load.flow_factor - self.owed_ul * self.per_ul

    def reached(self, at: JobPosition) -> JobPosition:
        """``at``, with this head's plunger in place of another's."""
        quanta = at.quanta.copy()
        quanta[_E] = self.quantum
        return replace(at, quanta=quanta, base=self.base)

    def remember(self, at: JobPosition) -> None:
        """Keep how far this head's plunger has come in the text."""
        self.quantum, self.base = int(at.quanta[_E]), at.base


@dataclass
class _Lines:
    """A part's rows as they gather, and the commands between them that are no rows."""

    tables: list[Table] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    rows: int = 0

    def add(self, table: Table) -> None:
        self.tables.append(table)
        self.rows += len(table.code)

    def say(self, *texts: str) -> None:
        self.row += [self.rows] * len(texts)
        self.text += texts

    def with_marks(self, marks: Marks) -> Marks:
        """Both in their places; a mark comes before what a change says at the same row."""
        merged = [
            *((row, 0, text) for row, text in zip(marks.row.tolist(), marks.text, strict=True)),
            *((row, 1, text) for row, text in zip(self.row, self.text, strict=True)),
        ]
        merged.sort(key=lambda entry: entry[:2])
        return Marks(np.array([row for row, *_ in merged], np.int64), [text for *_, text in merged])


class HeadsWriter(Writer):
    """Writes the parts of a job for a printer with several heads; see `Writer`.

    Raises
    ------
    ToolpathError
        When nobody said what each head holds, or the axis ends too low for a change.
    """

    def __init__(
        self,
        printer: Printer,
        syringe: Syringe,
        place_mm: FloatArray,
        options: GcodeOptions,
        top_mm: float,
    ) -> None:
        loads = options.heads or _alike(printer, syringe, options)
        if len(loads) != printer.head_count:
            raise ToolpathError(
                f"{printer.name} has {printer.head_count} heads, and {len(loads)} are said to "
                "hold something (options: heads); say it of each"
            )
        self._heads = [
            IdleHead(number, head, printer.of_head(number), load)
            for number, (head, load) in enumerate(zip(printer.heads, loads, strict=True))
        ]
        # The finest plunger's digits for all, so that one job has one writing of E.
        finest = max(one.printer.steps_per_mm.e for one in self._heads)
        steps = printer.steps_per_mm.model_copy(update={"e": finest})
        fine = printer.model_copy(update={"steps_per_mm": steps})
        super().__init__(fine, syringe, place_mm, options, top_mm)
        self._top = self._changing_height(printer)
        self._active = self._heads[0]
        self._chosen = False

    def _changing_height(self, printer: Printer) -> float:
        """Carriage's height at which every tip, lowered, is above what is written and the wall."""
        safe = max(self._path_top + self._options.clearance_mm, self._options.safe_z_mm or -np.inf)
        lowest = min(float(one.offset[2]) for one in self._heads)
        if safe - lowest > printer.z_mm.high + 1e-9:
            raise ToolpathError(
                f"heads are changed with the carriage at {safe - lowest:g} mm, so that every tip "
                f"is above {safe:g} mm; {printer.name} ends at {printer.z_mm.high:g} mm (z_mm); "
                "set the part lower, or take a lower dish"
            )
        return safe - lowest

    def write(self, toolpath: Toolpath, *, last: bool) -> Gcode:
        """Lines of the next part; the ``last`` one ends the job."""
        self._check(toolpath)
        runs = list(_runs(toolpath, self._active.number if self._chosen else None))
        lines, first = _Lines(), self._begin is None
        if first:
            self._set_out(toolpath, runs, lines)
        for number, rows in runs:
            if number != self._active.number:
                self._change(self._heads[number], toolpath.start[rows[0]], lines)
            self._run(toolpath, rows, lines)
        if last:
            self._leave(lines)
        table = _stacked(lines.tables)
        marks = marks_of(toolpath, table, Context(self._source, last))
        gcode = self._rendered(toolpath, table, lines.with_marks(marks))
        self._remember(toolpath)
        return self._framed(gcode, self._begin or self._at, first=first, last=last)

    def _check(self, toolpath: Toolpath) -> None:
        strange = np.setdiff1d(toolpath.tool, np.arange(len(self._heads)))
        if len(strange):
            raise ToolpathError(
                f"toolpath uses head {int(strange[0])}; {self._printer.name} has "
                f"{len(self._heads)} (heads)"
            )
        self._check_height(toolpath)

    # -- parts of a job

    def _set_out(self, toolpath: Toolpath, runs: list[tuple[int, IntArray]], lines: _Lines) -> None:
        """Raise all but the first head; say where its tip is; go up, across, and down if it's its.

        The job begins with the first head lowered: it was touched off so.
        """
        number, rows = runs[0]
        tip, options = toolpath.start[rows[0]] + self._place, self._options
        to = tip - self._heads[number].offset
        begin = begin_of(to, options)
        self._begin = self._reached = JobPosition.at(begin, self._printer)
        first = self._heads[0]
        for one in self._heads[1:]:
            lines.say(*_moved(one, to_raise=True))
        lines.say(first.head.select, *_moved(first, to_raise=False))
        self._chosen = True
        way = approach_commands(begin, to, self._top, first.printer, options)
        if number != 0:  # the change goes down itself
            way = way.where(np.array([True, True, False]))
        blind = options.start_mm is None
        table, self._reached = tabulate(way, self._reached, self._printer, blind=blind)
        declares = not blind and not self._dialect.declares
        lines.add(declare_position(table, self._begin, position=declares, plunger=True))

    def _change(self, new: IdleHead, first_mm: FloatArray, lines: _Lines) -> None:
        """Leave the head in use, take ``new``, and go to where its first move begins."""
        self._leave(lines)
        old, self._active = self._active, new
        select = [*_moved(old, to_raise=True), new.head.select]
        lines.say(*([";RELOAD"] if old.pushed_ul else []), *select)
        at = new.reached(self._at)
        table, at = counted_from(at, self._printer)
        lines.add(table)
        lines.say(*_moved(new, to_raise=False))
        to = np.append(first_mm + self._place - new.offset, new.plunger_mm)
        limits = new.printer.max_speed_mm_s
        level = min(self._options.travel_speed_mm_s, limits.x, limits.y)
        rise = min(self._options.travel_speed_mm_s, limits.z)
        way = [Stops.to(at_height(to, self._top), level, 0), Stops.to(to, rise, 0)]
        if new.owed_ul:
            primed = to + [0.0, 0.0, 0.0, new.owed_ul * new.per_ul]
            way.append(Stops.to(primed, new.load.plunger_ul_s * new.per_ul, 1))
            new.owed_ul = 0.0
        self._add(join_stops(way), new, lines, at)

    def _run(self, toolpath: Toolpath, rows: IntArray, lines: _Lines) -> None:
        """Moves of the head in use."""
        one = self._active
        part = toolpath.where(rows)
        place, load = self._place - one.offset, one.load
        body = stops(part, one.printer, load.syringe, place, load.flow_factor, one.pushed_ul)
        self._add(replace(body, move=rows[body.move]), one, lines)
        one.pushed_ul = float(np.cumsum(np.append(one.pushed_ul, part.volume_ul))[-1])
        doses = np.flatnonzero(part.volume_ul)
        if len(doses):
            one.relieved = bool(part.kind[doses[-1]] == MoveKind.RETRACT)

    def _leave(self, lines: _Lines) -> None:
        """Relieve the plunger, where it presses, and go straight up."""
        one, at = self._active, self._position()
        way: list[Stops] = []
        if not one.relieved and one.load.relieve_ul > 0:
            one.owed_ul, one.relieved = one.load.relieve_ul, True
            at = at.copy()
            at[3] = one.plunger_mm
            way.append(Stops.to(at, one.load.plunger_ul_s * one.per_ul, 1))
        rise = min(self._options.travel_speed_mm_s, one.printer.max_speed_mm_s.z)
        way.append(Stops.to(at_height(at, self._top), rise, 0))
        self._add(join_stops(way), one, lines)

    # -- text

    @property
    def _at(self) -> JobPosition:
        if self._reached is None:
            raise ToolpathError("the job hasn't begun; there is no place to go on from")
        return self._reached

    def _position(self) -> FloatArray:
        """Where the carriage and the plunger in use stand as written, (4,), mm."""
        position = self._at.position(self._printer)
        position[3] = self._active.plunger_mm
        return position

    def _add(
        self, commands: Stops, one: IdleHead, lines: _Lines, at: JobPosition | None = None
    ) -> None:
        """Rows of commands of one head, whose plunger's limits hold for them."""
        speed = one.printer.max_speed_mm_s
        own = self._printer.model_copy(update={"max_speed_mm_s": speed})
        table, reached = tabulate(commands, at or one.reached(self._at), own)
        lines.add(table)
        one.remember(reached)
        self._reached = reached


def _alike(printer: Printer, syringe: Syringe, options: GcodeOptions) -> tuple[HeadLoad, ...]:
    """The same in each head, where only one thing was said."""
    load = HeadLoad(syringe, options.flow_factor, options.relieve_ul, options.plunger_ul_s)
    return (load,) * printer.head_count


def _moved(one: IdleHead, *, to_raise: bool) -> list[str]:
    """Raise or lower a head with the motors standing, and wait until it is; nothing if fixed."""
    command = one.head.raises if to_raise else one.head.lowers
    if command is None:
        return ["M400"] if to_raise else []
    wait = [f"G4 P{np.ceil(one.head.moving_s * 1e3):.0f}"] if one.head.moving_s > 0 else []
    return ["M400", command, *wait]


def _runs(toolpath: Toolpath, active: int | None) -> Iterator[tuple[int, IntArray]]:
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


def _stacked(tables: list[Table]) -> Table:
    return Table(
        *(
            np.concatenate([getattr(table, name) for table in tables])
            for name in ("code", "value", "given", "source", "move")
        )
    )
