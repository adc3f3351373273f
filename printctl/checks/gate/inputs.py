"""Limits, inputs and verdict of the G-code gate on a line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

from firmware_profiles import Dish, Needle, Printer
from printctl.checks.set_up import WALL_CLEARANCE_MM, PlacedDish, hub_gap_of, wall_gap_of

Place = tuple[float, float, float]
NOT_BY_HAND: Final = "isn't for manual use"


class LineAction(StrEnum):
    """What carries an allowed line out."""

    SEND = "send"
    """It is sent as it is."""
    MOVE = "move"
    """A straight move of the tip to `Allowed.target`, at `Allowed.speed_mm_s`."""
    HOME = "home"
    """Homing of `Allowed.axes`."""
    HEAT = "heat"
    """A target for the heater `Allowed.heater`."""


@dataclass(frozen=True)
class AllowedLine:
    """Verdict on an allowed line.

    Attributes
    ----------
    text : str
        What is sent: rendered from what was understood.
    act : LineAction
    target : (x, y, z) or None, mm
        Of a move.
    speed_mm_s : float or None, mm/s
        Of a move, where the line says it.
    axes : tuple of str
        To home.
    heater : str
        ``nozzle``, ``nozzle 1``, ``bed``, ``chamber``, where the line sets a target; else empty.
    celsius : float, °C
    undo : tuple of str
        Settings (codes) that must be as before once the job has ended.
    """

    text: str
    act: LineAction = LineAction.SEND
    target: Place | None = None
    speed_mm_s: float | None = None
    axes: tuple[str, ...] = ()
    heater: str = ""
    celsius: float = 0.0
    undo: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class Refusal:
    """A line that may not leave.

    Attributes
    ----------
    message : str
        What, the value, its limit, where that comes from, and the remedy.
    """

    message: str


Verdict = AllowedLine | Refusal


class NotAllowed(Exception):  # noqa: N818 (an answer, which `printctl.checks.gate.judge` gives back)
    """Something that no line may do; the message is a refusal's."""


# What a station can't know it must be told, and where it wasn't told it allows small steps alone.
# Straight up is always free: the shaft stands above the tip already and meets nothing new.
RIM_MARGIN_MM: Final = 2.0
"""Kept above the rim by a needle that goes sideways over it."""
STEP_DOWN_MM: Final = 1.0
"""Largest step down, and beside a dish's wall, where nobody said what is there."""
STEP_ASIDE_MM: Final = 10.0
"""Largest step aside where the position isn't trusted and no dish was named."""
IN_DISH_MM_S: Final = 10.0
"""Fastest move of a needle below the rim."""
_TINY_MM: Final = 1e-6
_AXES: Final = "xyz"


@dataclass(frozen=True)
class Bounds:
    """What is known of the room around the tip.

    Attributes
    ----------
    printer : Printer
    trusted : bool
        Whether the printer's count means its frame.
    needle : Needle or None
    dish : Dish or None
    centre_mm : (x, y) or None, mm
        Of the dish.
    floor_mm : float or None, mm
        Height of the tip on the dish's floor, as the printer counts.
    bath_level_mm : float or None, mm
    part_in_dish : bool
        Whether something was written into the bath.
    clear_mm : float or None, mm
        In a pause of a print whose dish nobody named: height at which the pause left the needle,
        below which small steps alone are allowed.
    """

    printer: Printer
    trusted: bool = False
    needle: Needle | None = None
    dish: Dish | None = None
    centre_mm: tuple[float, float] | None = None
    floor_mm: float | None = None
    bath_level_mm: float | None = None
    part_in_dish: bool = False
    clear_mm: float | None = None

    @property
    def needle_above_dish(self) -> bool:
        """Whether there is something to run into."""
        return self.needle is not None and self.dish is not None

    @property
    def rim_mm(self) -> float | None:
        """Height below which the needle may not pass over the wall; None where unknown."""
        if not self.needle_above_dish or self.dish is None or self.floor_mm is None:
            return None
        return self.floor_mm + self.dish.wall_mm + RIM_MARGIN_MM

    @property
    def standing(self) -> PlacedDish | None:
        """The dish in its place, where that is known."""
        if not self.trusted or self.dish is None:
            return None
        if self.centre_mm is None or self.floor_mm is None:
            return None
        return PlacedDish(self.dish, self.centre_mm, self.floor_mm)


def check_move(bounds: Bounds, start: Place, target: Place) -> None:
    """Refuse a straight move of the tip that may run into something.

    Parameters
    ----------
    bounds : Bounds
    start, target : (x, y, z), mm
        As the printer counts.

    Raises
    ------
    NotAllowed
        What would be met, the value, its limit, and the remedy.
    """
    aside = math.hypot(target[0] - start[0], target[1] - start[1])
    up = target[2] - start[2]
    _in_machine(bounds, start, target)
    if aside <= _TINY_MM and up >= 0:
        return
    _above_floor(bounds, target)
    _small_if_unknown(bounds, min(start[2], target[2]), aside, up)
    _not_through_part(bounds, min(start[2], target[2]))
    _clear_of_wall(bounds, start, target)


def _in_machine(bounds: Bounds, start: Place, target: Place) -> None:
    printer = bounds.printer
    for axis, begin, end in zip(_AXES, start, target, strict=True):
        span = getattr(printer, f"{axis}_mm")
        if not bounds.trusted:
            if abs(end - begin) > span.high - span.low:
                raise NotAllowed(
                    f"a step of {end - begin:g} mm along {axis.upper()} is longer than the axis, "
                    f"{span.high - span.low:g} mm ({axis}_mm of {printer.name})"
                )
        elif end != begin and not span.low - _TINY_MM <= end <= span.high + _TINY_MM:
            raise NotAllowed(
                f"{axis.upper()} {end:.2f} mm is outside {span.low:g} to {span.high:g} mm "
                f"({axis}_mm of {printer.name}); take a shorter step, or correct the position "
                "if the tip isn't where the printer counts it"
            )


def _above_floor(bounds: Bounds, target: Place) -> None:
    floor = bounds.floor_mm
    if bounds.needle_above_dish and floor is not None and target[2] < floor - _TINY_MM:
        raise NotAllowed(
            f"Z {target[2]:.2f} mm is below the dish's floor, touched off at {floor:.2f} mm; the "
            "needle would go into the glass. Touch off again if another needle is mounted"
        )


def _small_if_unknown(bounds: Bounds, low_mm: float, aside: float, up: float) -> None:
    """Small steps alone where nobody said where tip, dish or floor are."""
    missing = _missing(bounds, low_mm)
    if not missing:
        return
    dish = bounds.needle_above_dish or bounds.clear_mm is not None
    most = STEP_DOWN_MM if dish else STEP_ASIDE_MM
    for what, mm, limit in (("down", -up, STEP_DOWN_MM), ("aside", aside, most)):
        if mm > limit + _TINY_MM:
            raise NotAllowed(
                f"{mm:g} mm {what} in one step, at most {limit:g} mm while {missing}; go up first "
                "if the way is longer"
            )


def _missing(bounds: Bounds, low_mm: float) -> str:
    if not bounds.trusted:
        return "the position isn't trusted (home without needle, or tell where the tip is)"
    if not bounds.needle_above_dish:
        if bounds.clear_mm is not None and low_mm < bounds.clear_mm - _TINY_MM:
            return (
                f"the needle may stand in a dish that nobody named, below Z {bounds.clear_mm:.2f} "
                "mm, where the pause left it"
            )
        return ""
    if bounds.floor_mm is None:
        return "the dish's floor isn't touched off"
    if bounds.centre_mm is None and low_mm < (bounds.rim_mm or math.inf):
        return "nobody said where the dish stands (dish_centre_mm)"
    return ""


def _not_through_part(bounds: Bounds, low_mm: float) -> None:
    if not bounds.part_in_dish or not bounds.needle_above_dish:
        return
    level = bounds.bath_level_mm if bounds.bath_level_mm is not None else bounds.rim_mm
    if level is not None and low_mm < level:
        raise NotAllowed(
            f"the tip would move at Z {low_mm:.2f} mm, below {level:.2f} mm, in a bath that holds "
            "a print: go straight up; say that another dish was put there (mount) to go down again"
        )


def _clear_of_wall(bounds: Bounds, start: Place, target: Place) -> None:
    standing, needle = bounds.standing, bounds.needle
    if standing is None or needle is None:
        return
    ends = (start, target)
    higher = standing.dish.model_copy(update={"wall_mm": standing.dish.wall_mm + RIM_MARGIN_MM})
    kept_clear = replace(standing, dish=higher)
    gaps = {
        "needle": wall_gap_of(ends, kept_clear, needle.outer_mm),
        "needle's hub": hub_gap_of(ends, standing, needle),
    }
    for what, gap in gaps.items():
        if gap < WALL_CLEARANCE_MM - _TINY_MM:
            raise NotAllowed(
                f"the {what} would come within {gap:.2f} mm of the wall of {standing.dish.name}, "
                f"at least {WALL_CLEARANCE_MM:g} mm is kept below Z {bounds.rim_mm:.2f} mm (its "
                f"rim and {RIM_MARGIN_MM:g} mm); go straight up above that first"
            )


def check_speed(bounds: Bounds, start: Place, target: Place, speed_mm_s: float) -> None:
    """Refuse a speed that the machine hasn't, or that is too fast beside a wall.

    Raises
    ------
    NotAllowed
    """
    if not math.isfinite(speed_mm_s) or speed_mm_s <= 0:
        raise NotAllowed(f"speed {speed_mm_s:g} mm/s isn't above 0")
    limit, why = speed_limit(bounds, start, target)
    if speed_mm_s > limit * (1 + 1e-9):
        raise NotAllowed(f"{speed_mm_s:g} mm/s exceeds {limit:g} mm/s ({why}); lower the speed")


def speed_limit(bounds: Bounds, start: Place, target: Place) -> tuple[float, str]:
    """Fastest along a straight move, mm/s, and what limits it."""
    length = math.dist(start, target)
    limits = []
    for axis, begin, end in zip(_AXES, start, target, strict=True):
        share = abs(end - begin) / length if length else 0.0
        if share > _TINY_MM:
            fastest = getattr(bounds.printer.max_speed_mm_s, axis)
            limits.append((fastest / share, f"max_speed_mm_s.{axis} of {bounds.printer.name}"))
    if min(start[2], target[2]) < _slow_below(bounds):
        limits.append((IN_DISH_MM_S, "a needle below the rim of the dish"))
    return min(limits, default=(IN_DISH_MM_S, "nothing moves"))


def _slow_below(bounds: Bounds) -> float:
    """Height below which a needle may be in a dish, mm."""
    if bounds.needle_above_dish:
        return math.inf if bounds.rim_mm is None else bounds.rim_mm
    return -math.inf if bounds.clear_mm is None else bounds.clear_mm


def reach(bounds: Bounds, at: Place) -> tuple[Place, Place]:
    """How far the tip may go from ``at`` along each axis alone, down and up; mm, printer's frame.

    The farthest single step; where steps must be small, a small one.
    """
    lows, highs = [], []
    for axis in range(3):
        span = getattr(bounds.printer, f"{_AXES[axis]}_mm")
        lows.append(_farthest(bounds, at, axis, min(span.low, at[axis])))
        highs.append(_farthest(bounds, at, axis, max(span.high, at[axis])))
    return (lows[0], lows[1], lows[2]), (highs[0], highs[1], highs[2])


def _farthest(bounds: Bounds, at: Place, axis: int, end: float) -> float:
    """Bisect: what may be reached along an axis is an interval that begins at the tip."""
    good, bad = at[axis], end
    if _may(bounds, at, axis, end):
        return end
    for _ in range(20):
        middle = (good + bad) / 2
        if _may(bounds, at, axis, middle):
            good = middle
        else:
            bad = middle
    return good


def _may(bounds: Bounds, at: Place, axis: int, value: float) -> bool:
    target = (*at[:axis], value, *at[axis + 1 :])
    try:
        check_move(bounds, at, (target[0], target[1], target[2]))
    except NotAllowed:
        return False
    return True


UNNAMED_C: Final = 45.0
"""Hottest target while nobody said which ink or bath is there: cells and proteins bear no more."""


class LineOrigin(StrEnum):
    """Origin of a G-code line."""

    CONSOLE = "console"
    """Typed by a person, a macro, or the REST API."""
    JOB = "job"
    """A job's file: a calibration print's and a recovery's rest, too."""


class Phase(StrEnum):
    """State of the printer."""

    STANDING = "standing"
    PRINTING = "printing"
    PAUSED = "paused"


@dataclass(frozen=True)
class Limit:
    """A limit of heat, °C, and where it comes from."""

    celsius: float
    why: str


_UNNAMED_INK: Final = Limit(UNNAMED_C, "no ink is named; name it (mount, --ink) if it bears more")
_UNNAMED_BATH: Final = Limit(
    UNNAMED_C, "no bath is named; name it (mount, --bath) if it bears more"
)


@dataclass(frozen=True)
class PrinterSituation:
    """The moment, as far as it is known.

    Attributes
    ----------
    bounds : Bounds
        The machine, and the room around the tip.
    phase : Phase
    position : (x, y, z) or None, mm
        Of the tip, as the printer counts.
    heat : mapping of str to Limit
        By heater: ``nozzle``, ``nozzle 1``, ``bed``, ``chamber``.
    heaters : tuple of str or None
        Those that the printer tells of; None where it hasn't been asked.
    plunger_mm : float or None, mm
        E as the printer counts it; None where it isn't known, or nobody may move it.
    plunger_mm_s : float, mm/s
        Fastest that the ink bears; infinite where nobody named it.
    needle_off : bool
        Whether a person said that the needle was taken off (homing).
    """

    bounds: Bounds
    phase: Phase = Phase.STANDING
    position: Place | None = None
    heat: Mapping[str, Limit] = field(default_factory=dict)
    heaters: tuple[str, ...] | None = None
    plunger_mm: float | None = None
    plunger_mm_s: float = float("inf")
    needle_off: bool = False

    @staticmethod
    def of_job(printer: Printer) -> PrinterSituation:
        """For a job's lines: its moves and its heat are judged by preflight, as a whole."""
        anything = Limit(math.inf, "judged by preflight")
        heat = dict.fromkeys(("nozzle", "bed", "chamber"), anything)
        return PrinterSituation(Bounds(printer), Phase.PRINTING, heat=heat)

    @property
    def printer(self) -> Printer:
        """Its profile."""
        return self.bounds.printer

    def hottest(self, heater: str) -> Limit:
        """Hottest target of a heater."""
        kind = heater.partition(" ")[0]
        unnamed = _UNNAMED_INK if kind == "nozzle" else _UNNAMED_BATH
        return self.heat.get(heater) or self.heat.get(kind) or unnamed
