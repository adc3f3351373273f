"""Parse a G-code file of any slicer into moves with layer, width and ink volume."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles.materials.bead import BeadSection
from gcode.errors import GcodeError, LineError
from gcode.heads import refuse_unread
from gcode.program.gcode import Program, code
from gcode.program.modal import BAD, DWELL, HOME, MOVE
from gcode.program.read_program import (
    Comments,
    declared_start,
    plain_lines,
    read_comments,
    read_written,
)
from gcode.program.valve import Valve, read_valves
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.checks.gcode_view.levels import fill_rows, is_flat, make_layers
from printctl.checks.gcode_view.line_map import KINDS, LineMap
from printctl.checks.gcode_view.pushing import Pushing
from printctl.errors import UsageError
from printctl.rounding import last_digit_mm, window_mm
from report.gcode import Act, GcodeJob, Layers

_STILL_MM: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Rows:
    """The program's rows that move or push.

    Attributes
    ----------
    row : (n,) int64
        In the program.
    start, end : (n, 3) float64, mm
    plunger : (n,) float64, mm
        How far it goes.
    time : (n,) float64, s
        From the feeds, with the dwells until the next row.
    act : (n,) uint8
        `Act`; a travel's height isn't looked at yet.
    """

    row: IntArray
    start: FloatArray
    end: FloatArray
    plunger: FloatArray
    time: FloatArray
    act: NDArray[np.uint8]

    @property
    def way(self) -> FloatArray:
        """Length of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


def written_rows(program: Program, valve: Valve | None, start_known: bool) -> Rows:
    """Take the rows that move or push.

    Parameters
    ----------
    program : Program
    valve : Valve or None
        Open, it makes a way a written one; without a valve a rising E does.
    start_known : bool
        Whether the program begins where the tip really stands.
    """
    begin = program.before[:, :3]
    end = program.target[:, :3]
    push = np.diff(program.plunger, prepend=0.0)
    way = np.linalg.norm(end - begin, axis=1)
    moving, homing = program.kind == MOVE, program.kind == HOME
    goes, pushes = moving & (way > _STILL_MM), moving & (np.abs(push) > _STILL_MM)
    kept = np.flatnonzero(goes | pushes | homing)
    act = np.full(len(program), Act.TRAVEL, np.uint8)
    act[goes & (push < -_STILL_MM)] = Act.WIPE
    act[pushes & ~goes] = np.where(push[pushes & ~goes] > 0, Act.PRIME, Act.RETRACT)
    act[goes & ((push > _STILL_MM) if valve is None else valve.is_open)] = Act.WRITE
    act[homing] = Act.JUMP
    if not start_known and len(kept):
        _forget_the_way_there(act, begin, end, goes)
    asked = np.where(goes, way, np.abs(push)) / np.maximum(program.feed, 1e-9)
    time = np.where(moving, asked, 0.0)
    time += np.where(program.kind == DWELL, np.nan_to_num(program.value), 0.0)
    if len(kept):
        whose = np.maximum(np.searchsorted(kept, np.arange(len(program)), side="right") - 1, 0)
        time = np.bincount(whose, weights=time, minlength=len(kept))
    return Rows(kept, begin[kept], end[kept], push[kept], time, act[kept])


def _forget_the_way_there(
    act: NDArray[np.uint8], begin: FloatArray, end: FloatArray, goes: BoolArray
) -> None:
    """Mark what comes before x, y and z have all been said once: its place isn't known."""
    moved = [np.flatnonzero(goes & (begin[:, axis] != end[:, axis])) for axis in range(3)]
    known = max((int(rows[0]) for rows in moved if len(rows)), default=-1)
    writes = np.flatnonzero(act == Act.WRITE)
    early = np.arange(len(act)) <= (min(known, int(writes[0])) if len(writes) else known)
    act[early & goes & (act != Act.WRITE)] = Act.JUMP


def plunger_doses(
    rows: Rows, program: Program, comments: Comments, pushing: Pushing
) -> tuple[FloatArray, float, str]:
    """Doses of a plunger.

    Returns
    -------
    dose : (n,) float64, µL
        Below 0 where it goes back.
    digit_ul : float, µL
        What E's last digit stands for.
    note : str
        Where the bore comes from.
    """
    bore, whence = pushing.bore_mm, pushing.bore_said
    if bore is None and comments.filament_mm is not None:
        bore, whence = comments.filament_mm, "filament_diameter in the file"
    if bore is None:
        bore, whence = pushing.syringe_mm, pushing.syringe_said
    area = math.pi * bore**2 / 4
    note = f"1 mm of E is {area:.4g} µL (bore {bore:g} mm: {whence})."
    return rows.plunger * area, last_digit_mm(program.plunger) * area, note


def valve_doses(rows: Rows, program: Program, pushing: Pushing) -> tuple[FloatArray, str]:
    """Return doses of pneumatic heads, (n,), µL, NaN where a flow isn't known; and a note on it."""
    measured = [head.measured and head.measured.flow_ul_s for head in pushing.printer.airs]
    flows = [pushing.flow_ul_s or one for one in measured]
    open_for = np.where(rows.act == Act.WRITE, rows.way / program.feed[rows.row], 0.0)
    if None in flows:
        unknown = np.where(rows.act == Act.WRITE, np.nan, 0.0)
        return unknown, (
            f"Nobody measured the flow of {pushing.printer.name}, so widths and volumes aren't "
            "known; --flow-ul-s says it."
        )  # fmt: skip
    whose = "--flow-ul-s" if pushing.flow_ul_s else "measured, printer's profile"
    each = np.array(flows, dtype=np.float64)
    said = ", ".join(f"{flow:.4g}" for flow in dict.fromkeys(each.tolist()))
    return open_for * each[program.tool[rows.row]], (
        f"While the valve is open {said} µL/s flow ({whose}), at the speed that is fed: "
        "lag, corners and delays aren't in it."
    )  # fmt: skip


def cross_sections(
    way: FloatArray, dose: FloatArray, begins: BoolArray, window: float
) -> FloatArray:
    """Cross-section of each written move, mm², as the mean over at least ``window`` mm of its run.

    Parameters
    ----------
    way, dose : (n,) float64, mm and µL
        Of the moves that write, in order.
    begins : (n,) bool
        Where a new run begins.
    window : float, mm
        Shortened at the ends of a run.
    """
    if not len(way):
        return np.zeros(0)
    at = np.concatenate([[0.0], np.cumsum(way)])
    pushed = np.concatenate([[0.0], np.cumsum(dose)])
    first = np.flatnonzero(begins)
    run = np.cumsum(begins) - 1
    low, high = at[first][run], at[np.append(first[1:], len(way))][run]
    middle, half = (at[:-1] + at[1:]) / 2, np.maximum(way, window) / 2
    begin, end = np.maximum(middle - half, low), np.minimum(middle + half, high)
    there = np.interp(end, at, pushed) - np.interp(begin, at, pushed)
    return np.asarray(np.where(way >= window, dose / way, there / (end - begin)))


def widths(area: FloatArray, height: FloatArray, bead: BeadSection) -> FloatArray:
    """Width of lines of a cross-section, mm.

    Parameters
    ----------
    area : (n,) float64, mm²
    height : (n,) float64, mm
        NaN for a round filament.
    bead : BeadSection
    """
    with np.errstate(invalid="ignore"):
        flat = bead.width(area, height)
    round_one = 2.0 * np.sqrt(np.maximum(area, 0.0) / math.pi)
    return np.where(np.isnan(height), round_one, flat)


_LIFT_MM: Final = 1e-3
_SHOWN_UNREAD: Final = 3
_MOVES: Final = re.compile(
    r"\s*(N\d+\s*)?(G0*([0-35]|1[01]|2[018]|5[3-9]|9[0-2])|M8[23])(?!\d)", re.IGNORECASE
)
"""Commands that move, or say how moves are to be read."""
_VOLUMES: Final = re.compile(rb"\nM200 D[1-9]")
_USUAL_RATIO: Final = (1.1, 8.0)
"""Width of a line over its height: of others the bore is likely to be a wrong one."""


@dataclass(frozen=True, eq=False)
class Reading:
    """A job, and what the reader made of the file before.

    Attributes
    ----------
    job : GcodeJob
    program : Program
    row : (n,) int64
        Row of the program of each of the job's moves.
    """

    job: GcodeJob
    program: Program
    row: IntArray


def read_job(gcode: bytes, name: str, pushing: Pushing, line_map: LineMap | None) -> GcodeJob:
    """Read a file; as `read_with_program`, the job alone."""
    return read_with_program(gcode, name, pushing, line_map).job


def read_with_program(
    gcode: bytes,
    name: str,
    pushing: Pushing,
    line_map: LineMap | None,
    *,
    strict: bool = False,
) -> Reading:
    """Read a file; lines that can't be read are left out, and the job's notes say so.

    Parameters
    ----------
    gcode : bytes
    name : str
        Of the file, for messages and titles.
    pushing : Pushing
    line_map : LineMap or None
    strict : bool
        Refuse a file with lines that can't be read.

    Raises
    ------
    UsageError
        When it isn't G-code, or nothing in it writes.
    """
    text = plain_lines(gcode)
    start = None if b"\0" in text else declared_start(text, pushing.printer)
    try:
        # All that can be drawn is: a print refuses such lines, and a viewer prints nothing.
        program, _, file, _ = read_written(
            text, pushing.printer, start or (0.0, 0.0, 0.0), max_refused=len(text)
        )
        refuse_unread(file.refused if strict else ())
    except GcodeError as exc:
        raise UsageError(f"{name}: {exc}") from exc
    valves = read_valves(program, file.others, pushing.printer)
    valve = Valve.joined(valves) if valves else None
    unread = _unread(file.refused)
    rows = written_rows(program, valve, start is not None)
    rows = _at_tips(rows, program.tool, pushing)
    if not (rows.act == Act.WRITE).any():
        raise UsageError(". ".join([_nothing(program, name, pushing, valve), *unread]))
    comments = read_comments(text)
    layer, layers = _layers(rows, program, comments, line_map, pushing.layer_mm)
    if valve is None:
        dose, digit_ul, said_dose = plunger_doses(rows, program, comments, pushing)
    else:
        dose, said_dose = valve_doses(rows, program, pushing)
        digit_ul = 0.0
    width, said_width = _widths(rows, layer, layers, dose, digit_ul, pushing.bead)
    line = program.line[rows.row]
    kind, kinds = _kinds(comments, line_map, line)
    job = GcodeJob(
        name=name,
        start=rows.start,
        end=rows.end,
        act=_with_lifts(rows, layer, layers),
        dose_ul=dose,
        width_mm=width,
        speed_mm_s=program.feed[rows.row],
        time_s=rows.time,
        line=line,
        kind=kind,
        kinds=kinds,
        vessel=line_map.source[line - 1] if line_map and line_map.of_vessels else None,
        layer=layer,
        layers=layers,
        text=text,
        notes=(*unread, said_dose, *said_width, *_doubts(program, text)),
    )
    return Reading(job, program, rows.row)


def _at_tips(rows: Rows, tool: IntArray, pushing: Pushing) -> Rows:
    """Places of the tips: of several heads the file says the carriage's."""
    if not pushing.printer.heads:
        return rows
    offsets = np.array([head.offset_mm.mm for head in pushing.printer.heads])
    own = offsets[np.clip(tool[rows.row], 0, len(offsets) - 1)]
    return replace(rows, start=rows.start + own, end=rows.end + own)


def _nothing(program: Program, name: str, pushing: Pushing, valve: Valve | None) -> str:
    """Why there is nothing to be seen."""
    moves = int((program.kind == MOVE).sum())
    if not moves:
        return (
            f"{name} holds no move (G0 to G3) in {len(program)} commands; is it a G-code file? "
            "`printctl slice` and `printctl toolpath` write one"
        )
    if valve is not None:
        head = pushing.printer.pneumatic
        opens = head.opens if head else ""
        return (
            f"{name}: none of its {moves} moves writes, since the valve is never opened ({opens}, "
            f"{pushing.printer.name}); name the printer that it is for with --printer"
        )
    return (
        f"{name}: none of its {moves} moves writes, since E never rises on the way; if a valve "
        "lets the ink out, name the printer that has it with --printer"
    )


def _layers(
    rows: Rows,
    program: Program,
    comments: Comments,
    line_map: LineMap | None,
    layer_mm: float | None,
) -> tuple[IntArray, Layers]:
    """Layer of each row, and the layers."""
    at = np.flatnonzero(rows.act == Act.WRITE)
    flat = is_flat(rows.start[at], rows.end[at])
    if line_map is not None and line_map.of_vessels:
        flat = False
    run = np.cumsum(np.diff(at, prepend=-2) != 1) - 1
    height = np.maximum(rows.start[at, 2], rows.end[at, 2])
    layer, layers = make_layers(height, program.line[rows.row[at]], run, flat, comments, layer_mm)
    return fill_rows(layer, at, len(rows.row)), layers


def _with_lifts(rows: Rows, layer: IntArray, layers: Layers) -> NDArray[np.uint8]:
    """Tell travels that leave the height of writing from those that keep to it."""
    if layers.passes:
        off = np.abs(rows.end[:, 2] - rows.start[:, 2]) > _LIFT_MM
        top = float(rows.end[rows.act == Act.WRITE, 2].max())
        off |= rows.end[:, 2] > top + _LIFT_MM
    else:
        z = layers.z_mm[layer]
        off = np.abs(np.stack([rows.start[:, 2], rows.end[:, 2]]) - z).max(axis=0) > _LIFT_MM
    return np.where(off & (rows.act == Act.TRAVEL), np.uint8(Act.LIFTED), rows.act)


def _widths(
    rows: Rows,
    layer: IntArray,
    layers: Layers,
    dose: FloatArray,
    digit_ul: float,
    bead: BeadSection,
) -> tuple[FloatArray, tuple[str, ...]]:
    """Width of each written row, mm, and how it was found."""
    at = np.flatnonzero(rows.act == Act.WRITE)
    way, pushed = rows.way[at], dose[at]
    result = np.full(len(rows.row), np.nan)
    if np.isnan(pushed).any():
        return result, ()
    window = window_mm(digit_ul, float(pushed.sum() / way.sum()))
    area = cross_sections(way, pushed, np.diff(at, prepend=-2) != 1, window)
    height = layers.height_mm[layer[at]]
    result[at] = widths(area, height, bead)
    if np.isnan(height).all():
        how = "Lines are taken as round"
    else:
        how = f"Lines are as high as the layer, with {bead.words}"
    over = f", as means over {window:.2g} mm, since E is rounded" if window > 0.05 else ""
    notes = [f"{how}; widths follow from volume and way{over}."]
    ratio = float(np.median(result[at] / height))
    if not (_USUAL_RATIO[0] <= ratio <= _USUAL_RATIO[1]) and not math.isnan(ratio):
        notes.append(
            f"Half of the moves write lines less than {ratio:.2g} times as wide as they are high: "
            "if that isn't meant, E is counted in another bore (--syringe, --filament-mm)."
        )
    return result, tuple(notes)


def _kinds(
    comments: Comments, line_map: LineMap | None, line: IntArray
) -> tuple[IntArray, tuple[str, ...]]:
    """What the last comment before each line calls it, else what the map says; -1 for nothing."""
    if len(comments.kind):
        at = np.searchsorted(comments.kind_lines, line) - 1
        return np.asarray(np.where(at >= 0, comments.kind[np.maximum(at, 0)], -1)), comments.kinds
    if line_map is not None and line_map.kind is not None:
        return line_map.kind[line - 1], KINDS
    return np.full(len(line), -1, np.int64), ()


def _unread(refused: Sequence[tuple[int, LineError]]) -> tuple[str, ...]:
    """How many lines are left out, the first of them, and where that may displace the drawing."""
    if not refused:
        return ()
    firsts = {str(error): line for line, error in reversed(refused)}
    shown = sorted((line, text) for text, line in firsts.items())[:_SHOWN_UNREAD]
    lost = [line for line, error in refused if _MOVES.match(error.line)]
    behind = f"; from line {lost[0]} on moves may be missing or displaced" if lost else ""
    return (
        f"{len(refused)} lines are left out, as a print of this file would refuse them (the first "
        f"of each: {'; '.join(f'line {line}: {text}' for line, text in shown)}){behind}.",
    )


def _doubts(program: Program, text: bytes) -> tuple[str, ...]:
    """What this reading leaves out."""
    doubts = []
    flows = (program.code == code("M221")) & (np.nan_to_num(program.value, nan=100.0) != 100.0)
    if flows.any():
        line = int(program.line[flows][0])
        doubts.append(f"The flow factor of line {line} (M221) isn't in the volumes.")
    if _VOLUMES.search(text):
        doubts.append("M200 makes E a volume; widths here take it as a length.")
    bad = int((program.kind == BAD).sum())
    if bad:
        doubts.append(f"{bad} arcs can't be made out and aren't shown.")
    return tuple(doubts)
