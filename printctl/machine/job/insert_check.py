"""Check lines to insert in a running print: allowed codes, limits, same position at the end.

A job's file is judged as a whole before its first line: codes by the gate, places, speeds and
heights by preflight. An insert comes in the middle of the print, so this is narrower than both. It
moves, pushes the plunger, waits, and counts the plunger anew; it sets nothing. It keeps to the
machine's travel, to the job's own least height and, below the job's greatest height, to what the
job's own moves stand on (`JobReach`), for which the job's checks hold. All raise `Refused`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from gcode.reading import GcodeLine, read_sent
from gcode.reading.read import LEAST, MOST
from printctl.machine.errors import JobError, Refused
from printctl.machine.job.coordinates import Modal, Move, Place, Spot, moves_of
from printctl.machine.job.dispensing import is_about_valve, is_open
from printctl.machine.job.job import Job, parse_job

MAX_LINES: Final = 20_000
MAX_WAIT_S: Final = 60.0
MAX_INSERT_S: Final = 1800.0
MAX_RELIEF_MM: Final = 10.0
"""Farthest that an insert may draw the plunger back: a relief, and no opening of the syringe."""
MAX_PUSH_MM: Final = 60.0
"""Farthest that one may push it where the profile names no travel."""
MAX_MOVE_PUSH_MM: Final = 200.0
"""Marlin's own limit of one move of the plunger (EXTRUDE_MAXLENGTH)."""
ASIDE_MM: Final = 1.0
"""So far beside the hull of the job's moves a needle may still go below the job's top."""
_MOVES: Final = ("G0", "G1")
_ALLOWED: Final = frozenset({*_MOVES, "G4", "G92", "G90", "G21", "M82", "M117", "M400"})
_SAME_MM: Final = 5e-4
_SAME_E_MM: Final = 1e-5
_SAME_PLUNGER_MM: Final = 1e-3
_TINY_MM: Final = 1e-9
_ROUNDING_MM: Final = 1e-6
_ROUNDING: Final = 1 + 1e-6
_LONGEST_NUMBER: Final = b"N9999999 *255\n"
_AXES: Final = "xyz"
Point = tuple[float, float]


@dataclass(frozen=True)
class JobReach:
    """What a job's moves keep to, counted from where the tip was touched off.

    ``low_mm`` and ``top_mm`` are the least and greatest height; infinite the other way round where
    no move names any. ``hull_mm`` are the corners, against the clock, of what its moves below the
    top stand on (of all where every one is as high), ``high_hull_mm`` of what all its moves stand
    on. ``push_mm_s`` is the fastest that they push the plunger.
    """

    low_mm: float
    top_mm: float
    hull_mm: tuple[Point, ...]
    push_mm_s: float = 0.0
    high_hull_mm: tuple[Point, ...] = ()

    @staticmethod
    def of(
        lines: Sequence[bytes],
        start_mm: Place | None = None,
        shift_at: Callable[[int], Place] = lambda index: (0.0, 0.0, 0.0),
    ) -> JobReach:
        """Read it from a job's lines.

        The tip stands at ``start_mm`` before the first; ``shift_at`` a line is what it calls places
        beyond the count from the touch-off (`JobFrame.shift_at`), mm.
        """
        spots, fastest = set[Place](), 0.0
        for move in moves_of(lines, at=Spot(*(start_mm or ()))):
            line, begin, end, _ = move
            dx, dy, dz = shift_at(line)
            if end.e > begin.e:
                fastest = max(fastest, move.push_mm_s)
                if not spots:  # the first line is written from the touch-off
                    spots.add((begin.x - dx, begin.y - dy, begin.z - dz))
            spots.add((end.x - dx, end.y - dy, end.z - dz))
        heights = [z for _, _, z in spots if z == z]
        low, top = min(heights, default=math.inf), max(heights, default=-math.inf)
        known = [spot for spot in spots if spot[0] == spot[0] and spot[1] == spot[1]]
        below = _hull({(x, y) for x, y, z in known if z < top - _ROUNDING_MM})
        high = _hull({*below, *((x, y) for x, y, z in known if not z < top - _ROUNDING_MM)})
        return JobReach(low, top, below or high, fastest, high)

    def is_inside(self, x: float, y: float, z: float) -> bool:
        """Whether a place is within the hull of its height, or at most `ASIDE_MM` beside it."""
        high = z >= self.top_mm - _ROUNDING_MM and self.high_hull_mm
        corners = high or self.hull_mm
        if len(corners) < 3:
            edges = list(zip(corners, corners[1:] or corners, strict=False))
        else:
            edges = list(zip(corners, (*corners[1:], corners[0]), strict=True))
            if all(_turn(one, other, (x, y)) >= 0 for one, other in edges):
                return True
        return any(_distance_mm(one, other, (x, y)) <= ASIDE_MM for one, other in edges)


def _hull(points: set[Point]) -> tuple[Point, ...]:
    """Convex hull, against the clock (A. M. Andrew, Inf. Process. Lett. 9, 216, 1979)."""
    order = sorted(points)
    if len(order) < 3:
        return tuple(order)
    return (*_half(order), *_half(order[::-1]))


def _half(order: Sequence[Point]) -> list[Point]:
    points: list[Point] = []
    for x, y in order:
        while len(points) > 1:
            (ax, ay), (bx, by) = points[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:  # `_turn`, for every move of a job
                break
            points.pop()
        points.append((x, y))
    return points[:-1]


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _distance_mm(a: Point, b: Point, c: Point) -> float:
    """Distance of ``c`` from the way between ``a`` and ``b``, mm."""
    length = math.dist(a, b)
    along = (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])
    share = min(max(along / length**2, 0.0), 1.0) if length else 0.0
    return math.dist((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])), c)


@dataclass(frozen=True)
class InsertPlace:
    """Where an insert begins.

    ``at`` is where the print is held, mm; ``shift_mm`` what the job calls places there beyond the
    count of the machine's frame. ``plunger_mm_s`` is the fastest that the ink bears; infinite where
    it names none.
    """

    at: Modal
    reach: JobReach
    printer: Printer
    plunger_mm_s: float = math.inf
    shift_mm: Place = (0.0, 0.0, 0.0)

    def from_touch_off(self, spot: Spot) -> Place:
        """Return a place counted from the touch-off, mm; NaN where unknown."""
        dx, dy, dz = self.shift_mm
        return spot.x - dx, spot.y - dy, spot.z - dz


def judged_lines(texts: Sequence[str], place: InsertPlace, name: str) -> tuple[bytes, ...]:
    """Return an insert's lines as they are sent; ``name`` is what it is called in messages.

    Refused is the first line that can't be sent, with the reason, or what isn't at its end as it
    was at its begin.
    """
    if not texts or len(texts) > MAX_LINES:
        raise Refused(f"{name} has {len(texts)} lines; it may have 1 to {MAX_LINES:,}")
    if any("\n" in text or "\r" in text for text in texts):
        raise Refused(f"{name} has a line end within a line; put each command on a separate line")
    try:
        job = parse_job("\n".join(texts).encode("ascii"), name, place.printer)
    except (JobError, UnicodeEncodeError) as exc:
        raise Refused(f"{name} isn't accepted: {exc}") from exc
    if None in (place.at.x, place.at.y, place.at.z):
        raise Refused(f"{name} isn't accepted: the job doesn't set the needle position there")
    insert = _Insert(place, Spot.of(place.at))
    for line, number in zip(job.lines, job.file_lines, strict=True):
        try:
            insert.take(line)
        except Refused as exc:
            raise Refused(f"{name}, line {number} ({line.decode('ascii')}): {exc}") from exc
    insert.check_end(name)
    if is_open(job.lines, len(job), place.printer):
        raise Refused(f"{name} ends with the valve open; close it at the end")
    _check_same(insert.at, Spot.of(place.at), name)
    return tuple(job.lines)


@dataclass
class _Insert:
    """An insert that is read line by line; ``at`` is where it leads so far.

    ``plunger_mm`` counts from where the plunger stood as the insert begins, whatever that is called
    (G92); ``seconds`` are of moves at the speeds asked for, and waits.
    """

    place: InsertPlace
    at: Spot
    plunger_mm: float = 0.0
    seconds: float = 0.0

    def take(self, line: bytes) -> None:
        """Judge a line, and add it up."""
        if len(line) + len(_LONGEST_NUMBER) > self.place.printer.max_line_bytes:
            raise Refused("it is too long for the firmware (profile: max_line_bytes)")
        if is_about_valve(line, self.place.printer):
            return
        read = read_sent(line)
        if read.code not in _ALLOWED:
            raise Refused(
                f"{read.code} can't be injected: injected G-code moves (G0, G1), waits (G4, M400) "
                "and resets E (G92 E); heaters, motors, heads and settings belong to the job"
            )
        if read.code == "G4":
            self._wait(read)
        elif read.code == "G92":
            e_mm = read.number("E")
            if set(read.words) != {"E"} or e_mm is None:
                raise Refused("injected G-code may only reset E (G92 E), no other axis")
            self.at = self.at._replace(e=e_mm)
        elif read.code in _MOVES:
            self._move(read)
        if self.plunger_mm < -MAX_RELIEF_MM:
            raise Refused(
                f"the plunger would be {-self.plunger_mm:.3g} mm behind its position; the maximum "
                f"retraction in injected G-code is {MAX_RELIEF_MM:g} mm"
            )
        if self.seconds > MAX_INSERT_S:
            raise Refused(
                f"the injected G-code would take more than {MAX_INSERT_S / 60:g} min with the "
                "needle in the bath; raise F, dwell less, or fill fewer gaps at a time"
            )

    def _wait(self, read: GcodeLine) -> None:
        seconds = (read.number("P") or 0.0) / 1e3 + (read.number("S") or 0.0)
        if seconds > MAX_WAIT_S:
            raise Refused(
                f"a dwell of {seconds:g} s; the maximum in injected G-code is {MAX_WAIT_S:g} s"
            )
        self.seconds += seconds

    def _move(self, read: GcodeLine) -> None:
        words = {axis.lower(): read.number(axis) for axis in "XYZEF" if axis in read.words}
        numbers = {axis: mm for axis, mm in words.items() if mm is not None}
        if len(numbers) < len(words):
            raise Refused("an axis without a number")
        move = Move(0, self.at, self.at._replace(**numbers))
        if "e" in words and self.place.printer.pneumatic is not None:
            raise Refused(f"{self.place.printer.name} has a valve but no plunger")
        if "e" in words and math.isnan(self.at.e):
            raise Refused("the E position is unknown there; set it first (G92 E)")
        if math.isnan(move.end.f):
            raise Refused("no feed rate is specified (F)")
        _check_space(move, self.place)
        push = move.end.e - move.begin.e if "e" in words else 0.0
        _check_speeds(move, abs(push), self.place)
        self.at = move.end
        self.plunger_mm += push
        way = move.way_mm or abs(push)
        self.seconds += 60.0 * way / move.end.f if move.end.f else 0.0

    def check_end(self, name: str) -> None:
        """Refuse an insert behind which the plunger stands elsewhere than its count says."""
        if self.plunger_mm < -_SAME_PLUNGER_MM:
            raise Refused(
                f"{name} leaves the plunger {-self.plunger_mm:.3g} mm behind its start position, "
                "so the next extrusion would be dry; undo the retraction"
            )
        most = self.place.printer.plunger_travel_mm or MAX_PUSH_MM
        if self.plunger_mm > most:
            raise Refused(
                f"{name} advances the plunger by {self.plunger_mm:.3g} mm, but only {most:g} mm "
                "are left"
            )


def _check_space(move: Move, place: InsertPlace) -> None:
    """Refuse a move beyond the machine or the space that the job keeps to."""
    printer, reach = place.printer, place.reach
    begin, end = place.from_touch_off(move.begin), place.from_touch_off(move.end)
    for axis, was, mm in zip(_AXES, begin, end, strict=True):
        span = getattr(printer, f"{axis}_mm")
        if mm != was and not span.low - _TINY_MM <= mm <= span.high + _TINY_MM:
            raise Refused(
                f"{axis.upper()} {mm:.3f} mm is outside {span.low:g} to {span.high:g} mm "
                f"({axis}_mm of {printer.name})"
            )
    held = place.from_touch_off(Spot.of(place.at))
    if end[2] < min(reach.low_mm, held[2]) - _SAME_MM:
        raise Refused(
            f"Z {end[2]:g} mm is below {reach.low_mm:g} mm, the least height of the job's own moves"
        )
    low = min(begin[2], end[2]) + _SAME_MM
    if begin[:2] != end[:2] and not reach.is_inside(end[0], end[1], low):
        where = f"below Z {reach.top_mm:g} mm " if low < reach.top_mm else ""
        raise Refused(
            f"X {end[0]:g} Y {end[1]:g} is more than {ASIDE_MM:g} mm beside all of the job's own "
            f"moves {where}and the needle's shaft isn't known to be clear there"
        )


def _check_speeds(move: Move, push: float, place: InsertPlace) -> None:
    """Refuse a move that an axis or the ink doesn't bear."""
    printer, feed = place.printer, move.end.f / 60
    travel = min(MAX_MOVE_PUSH_MM, printer.plunger_travel_mm or math.inf)
    if push > travel:
        raise Refused(
            f"the plunger would move {push:g} mm in one move; the maximum is {travel:g} mm"
        )
    steps = (abs(b - a) for a, b in zip(move.begin[:3], move.end[:3], strict=True))
    lengths = dict(zip("xyze", (*steps, push), strict=True))
    limits = {axis: getattr(printer.max_speed_mm_s, axis) for axis in lengths}
    own = max(place.plunger_mm_s, place.reach.push_mm_s)  # the job's checks took its own pushes
    limits["e"] = min(limits["e"], own)
    path = move.way_mm or push
    for axis, mm in lengths.items():
        speed = feed * mm / path if path else 0.0
        if speed > limits[axis] * _ROUNDING:
            source = "max_speed_mm_s of the printer, plunger_ul_s of the ink, the job's own"
            raise Refused(
                f"{speed:g} mm/s of {axis.upper()} exceeds {limits[axis]:g} ({source}); lower F"
            )


def _check_same(at: Spot, begin: Spot, name: str) -> None:
    """Refuse an insert behind which the job's next line would mean something else."""
    for axis, was, now in zip("xyzef", begin, at, strict=True):
        within = _SAME_E_MM if axis == "e" else _SAME_MM
        if math.isnan(was) or abs(now - was) <= within:
            continue
        remedy = {
            "e": f"end it with G92 E{was:.5f}",
            "f": f"end it with G1 F{was:g}",
        }.get(axis, f"go back to {axis.upper()}{was:g} at its end")
        raise Refused(
            f"{name} ends at {axis.upper()}{now:g} but the job continues from "
            f"{axis.upper()}{was:g}: " + remedy
        )


def check_factor(flow: float, place: InsertPlace, name: str) -> None:
    """Refuse a flow out of bounds, or where not one plunger doses all."""
    printer = place.printer
    if printer.pneumatic is not None or len(printer.heads) > 1:
        what = "several heads" if printer.heads else "a valve but no plunger"
        raise Refused(f"{name} isn't accepted: {printer.name} has {what}, so no flow can be set")
    if not LEAST <= flow <= MOST:
        raise Refused(
            f"{name} isn't accepted: a flow factor of {flow:g} is outside {LEAST:g} to {MOST:g}; "
            "check ink, syringe and needle"
        )
    if place.at.e is None:
        raise Refused(f"{name} isn't accepted: the E position is unknown there")


def check_flow(job: Job, grown: Job, place: InsertPlace, name: str) -> None:
    """Refuse a flow at which a move pushes faster than drive or ink bear.

    Moves that the file itself makes so fast pass. ``job`` is without the insert, and ``grown`` with
    it as the last one.
    """
    printer, after = place.printer, grown.inserts[-1].after
    limit = min(printer.max_speed_mm_s.e, place.plunger_mm_s)
    own, now = _fastest_push(job, place, after), _fastest_push(grown, place, after)
    if now > max(limit, own) * _ROUNDING:
        raise Refused(
            f"{name} isn't accepted: at a flow factor of {grown.flow:g} the plunger would move at "
            f"{now:g} mm/s, above the maximum of {limit:g} (max_speed_mm_s.e of {printer.name}, "
            "plunger_ul_s of the ink)"
        )
    longest, before = max(map(len, grown.lines)), max(map(len, job.lines))
    if longest > max(printer.max_line_bytes - len(_LONGEST_NUMBER), before):
        raise Refused(f"{name} isn't accepted: a line would have {longest} bytes (max_line_bytes)")


def _fastest_push(job: Job, place: InsertPlace, begin: int) -> float:
    """Fastest push of the job's moves across from a line on, mm/s."""
    moves = moves_of(job.lines, begin, at=Spot.of(place.at))
    return max((move.push_mm_s for move in moves if move.path_mm), default=0.0)
