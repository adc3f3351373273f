"""Execute manual commands on an idle printer, within limits: move, home, heat, push, touch off.

Each returns what is answered to its request. What it refuses moves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from firmware_profiles.families import family_of
from printctl.checks.gate import (
    DEFAULT_MM_S,
    LineAction,
    LineOrigin,
    NotAllowed,
    PrinterSituation,
    check_heat,
    check_homing,
    check_step,
    judge,
    speed_limit,
)
from printctl.checks.gate.firmware import LISTED, levelling_is_on, questions
from printctl.machine.control.board.heat import target_command
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.gating import allowed_command
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.manual_motion import push, travel
from printctl.machine.control.idle.standby import ElsewhereError, Standby
from printctl.machine.control.idle.station_status import Place
from printctl.machine.errors import LinkError, Refused

AXES: Final = "xyz"
UNNAMED_UL_S: Final = 1.0
"""Fastest push of an ink that isn't named."""
_TINY: Final = 1e-9

Answer = dict[str, Any]


class IdleCommands:
    """Grants requests one at a time, in the thread that speaks to the printer."""

    def __init__(self, standby: Standby, known: Knowledge) -> None:
        self.standby, self.known = standby, known
        moves = self.jog, self.move_to, self.home, self.plunger, self.command
        others = self.heat, self.touch_off, self.set_position
        self.requests: Mapping[str, Callable[..., Answer | Steps[Answer]]] = {
            one.__name__: one for one in (*moves, *others)
        }

    def grant(self, do: str, values: Mapping[str, Any]) -> Answer:
        """Do what is requested; return what is answered.

        Raises
        ------
        PrintEnded, LinkError
            `Refused` before anything moves; or as the printer's troubles are.
        """
        granted = self.requests[do](**values)
        return granted if isinstance(granted, dict) else self.standby.drive(granted)

    # --- motion --------------------------------------------------------------------------------

    def jog(self, by: dict[str, float], speed_mm_s: float | None = None) -> Steps[Answer]:
        """Move by so many mm along axes."""
        _only_axes(by)
        x, y, z = (mm + by.get(axis, 0.0) for axis, mm in zip(AXES, self._at(), strict=True))
        return (yield from self._go((x, y, z), speed_mm_s))

    def move_to(
        self,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        speed_mm_s: float | None = None,
    ) -> Steps[Answer]:
        """Move in a straight line to a place; an axis that isn't given stays."""
        if not self.known.trusted:
            raise Refused(
                "the position isn't trusted, so absolute moves are refused: home without a needle, "
                "or set the tip position (set_position); small steps (jog) are allowed"
            )
        return (yield from self._go(self._with(x, y, z), speed_mm_s))

    def _go(self, target: Place, speed: float | None) -> Steps[Answer]:
        at, bounds = self._at(), self.known.bounds
        if math.dist(at, target) < _TINY:
            return {}
        mm_s = min(DEFAULT_MM_S, speed_limit(bounds, at, target)[0])
        mm_s = mm_s if speed is None else speed
        try:
            check_step(self._known, at, target, mm_s)
        except NotAllowed as exc:
            raise Refused(str(exc)) from exc
        try:
            whole = yield from travel(self.standby, target, mm_s)
        except ElsewhereError:
            self.known.lose_position()
            raise
        return {"message": "" if whole else "the move was stopped before its target"}

    def home(self, axes: Sequence[str], needle_off: bool = False) -> Steps[Answer]:
        """Home axes, and switch off what that switches on in the firmware."""
        _only_axes(axes)
        try:
            check_homing(replace(self._known, needle_off=needle_off))
        except NotAllowed as exc:
            raise Refused(str(exc)) from exc
        yield from self.standby.do("G28 " + " ".join(axis.upper() for axis in axes), "M400")
        message = yield from self._level_off()
        yield from self.standby.look()
        self.known.home(set(axes))
        return {"message": message}

    def _level_off(self) -> Steps[str]:
        """Switch bed levelling off that G28 has switched on; return what was done, or ''.

        A Marlin that was built with ENABLE_LEVELING_AFTER_G28 does so, and a start is then refused.
        Later it would change what the height of a tip is called that was touched off meanwhile.
        """
        printer = self._known.printer
        if LISTED not in questions(printer):
            return ""
        if not levelling_is_on((yield from self.standby.do(LISTED)), printer):
            return ""
        yield from self.standby.do("M420 S0")
        return "homing switched bed levelling on; it was switched off again (M420 S0)"

    def plunger(self, ul: float, ul_s: float | None = None) -> Steps[Answer]:
        """Push (above 0) or draw back so many µL."""
        per_mm, most, why = self._push_limits()
        speed = most if ul_s is None else ul_s
        if not 0 < speed <= most * (1 + _TINY):
            raise Refused(f"{speed:g} µL/s is outside 0 to {most:g} µL/s ({why})")
        self._within_syringe(ul / per_mm, per_mm)
        if ul > 0 and self.standby.trouble:
            raise Refused(f"dispensing is disabled: {self.standby.trouble}; retract instead")
        before, asked = self.standby.plunger, ul / per_mm
        try:
            moved = (yield from push(self.standby, asked, speed / per_mm)) if asked else 0.0
        finally:
            self._count_plunger(before)
        whole = abs(moved) >= abs(asked) - _TINY
        return {"message": "" if whole else "the plunger was stopped before its target"}

    def _count_plunger(self, before: float | None) -> None:
        """Add what the printer says it has moved; where it doesn't say, that is unknown."""
        after, used = self.standby.plunger, self.known.plunger_mm
        if before is None or after is None or used is None:
            self.known.plunger_mm = None
        else:
            self.known.plunger_mm = used + after - before

    def _push_limits(self) -> tuple[float, float, str]:
        """µL per mm, fastest flow in µL/s, and what limits that."""
        printer, profiles = self.known.printer, self.known.profiles
        if printer.pneumatic is not None:
            raise Refused(f"{printer.name} has a valve but no plunger; only a print opens it")
        if printer.heads:
            raise Refused(
                f"{printer.name} has several heads; moving a plunger manually isn't supported "
                "there, only during a syringe change in a print"
            )
        per_mm = profiles.ul_per_mm
        if per_mm is None:
            raise Refused("no syringe is specified as mounted; specify it (mount) to move in µL")
        machine = printer.max_speed_mm_s.e * per_mm, f"max_speed_mm_s.e of {printer.name}"
        ink = profiles.ink
        own = (
            (ink.plunger_ul_s, f"plunger_ul_s of {ink.name}")
            if ink
            else (UNNAMED_UL_S, "no ink is specified; specify it (mount) if it tolerates more")
        )
        most, why = min(machine, own)
        return per_mm, most, why

    def _within_syringe(self, mm: float, per_mm: float) -> None:
        used, left = self.known.plunger_mm, self.known.plunger_left_mm
        if used is None or left is None:
            raise Refused(
                "the plunger position isn't set; set it (mount syringe, plunger_mm: 0 for a full "
                "one)"
            )
        if mm > left + _TINY:
            raise Refused(
                f"{mm * per_mm:g} µL exceeds the {left * per_mm:.2f} µL left in "
                f"{self.known.mounted.syringe} (without its dead volume, or limited by the drive's "
                "travel)"
            )
        if mm < -used - _TINY:
            raise Refused(
                f"{-mm * per_mm:g} µL of retraction exceeds the {used * per_mm:.2f} µL dispensed; "
                f"{self.known.mounted.syringe} would be full there"
            )

    # --- heat and console ----------------------------------------------------------------------

    def heat(self, name: str, celsius: float) -> Steps[Answer]:
        """Set a heater's target."""
        try:
            check_heat(self._known, name, celsius)
        except NotAllowed as exc:
            raise Refused(str(exc)) from exc
        yield from self.standby.do(target_command(name, celsius))
        self.standby.ask_soon()
        return {}

    def command(self, text: str) -> Steps[Answer]:
        """Send a line of the console; one that moves or heats goes the way of that request."""
        line = allowed_command(judge(text, LineOrigin.CONSOLE, self._known))
        if line.act is LineAction.SEND:
            lines = yield from self.standby.do(line.text)
            yield from self.standby.look()
            return {"lines": lines}
        if line.act is LineAction.MOVE and line.target is not None:
            answer = yield from self._go(line.target, line.speed_mm_s)
        elif line.act is LineAction.HOME:
            if not self.known.needle_known:
                raise Refused(
                    "homing drives an axis through whatever is in the way, and it is unknown "
                    "whether a needle is mounted: use Home (Printer page, `printctl station "
                    "home`), which asks, or first specify what is mounted (mount; '' for no needle)"
                )
            answer = yield from self.home(line.axes)
        else:
            answer = yield from self.heat(line.heater, line.celsius)
        return {"lines": [answer["message"]] if answer.get("message") else []}

    @property
    def _known(self) -> PrinterSituation:
        """What the gate is told."""
        standby = self.standby
        heaters = tuple(one.name for one in standby.temperatures)
        return replace(self.known.limits, position=standby.position, heaters=heaters)

    # --- where it is ---------------------------------------------------------------------------

    def touch_off(self, z: float | None = None, foil_mm: float = 0.0) -> Answer:
        """Take the tip's height, or ``z``, less a foil's thickness for the dish's floor."""
        mounted, at = self.known.mounted, self._at()
        if not mounted.needle or not mounted.dish:
            raise Refused(
                "touching off a floor needs a needle and a dish; specify them first (mount)"
            )
        if not 0 <= foil_mm <= 2:
            raise Refused(f"a foil of {foil_mm:g} mm is outside 0 to 2 mm")
        self.known.mount({"floor_mm": (at[2] if z is None else z) - foil_mm})
        return {}

    def set_position(
        self, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> Steps[Answer]:
        """Tell the firmware where the tip is; nothing moves."""
        printer = self.known.printer
        given = {axis: mm for axis, mm in zip(AXES, (x, y, z), strict=True) if mm is not None}
        if not given:
            raise Refused("no axis is specified; specify x, y or z in mm")
        for axis, mm in given.items():
            span = getattr(printer, f"{axis}_mm")
            if not span.low <= mm <= span.high:
                raise Refused(
                    f"{axis.upper()} {mm:g} mm is outside {span.low:g} to {span.high:g} mm "
                    f"({axis}_mm of {printer.name}); the tip can't be there"
                )
        yield from self.declare(self._with(x, y, z), set(given))
        return {}

    def declare(self, place: Place, axes: set[str]) -> Steps[None]:
        """Tell the firmware where the tip is; axes that aren't given stay as they count."""
        at = self._at()
        yield from self.standby.do(self._declaration(place, axes))
        self.known.count_anew(at, place, axes)
        yield from self.standby.look()

    def _declaration(self, place: Place, given: set[str]) -> str:
        declares = family_of(self.known.printer).dialect(self.known.printer).declares
        if declares:  # all three at once
            x, y, z = (f"{mm:.4f}" for mm in place)
            return declares.format(x=x, y=y, z=z)
        words = (
            f"{axis.upper()}{mm:.4f}" for axis, mm in zip(AXES, place, strict=True) if axis in given
        )
        return "G92 " + " ".join(words)

    def _with(self, *given: float | None) -> Place:
        """Return the tip's place with what is given of it."""
        x, y, z = (at if mm is None else mm for mm, at in zip(given, self._at(), strict=True))
        return x, y, z

    def _at(self) -> Place:
        at = self.standby.position
        if at is None:
            raise LinkError("the printer doesn't report its position (M114); reconnect")
        return at


def _only_axes(given: Sequence[str] | dict[str, float]) -> None:
    unknown = [name for name in given if name not in AXES or len(name) != 1]
    if unknown or not given:
        raise Refused(f"axis {unknown[0] if unknown else 'none'} is none of {', '.join(AXES)}")
