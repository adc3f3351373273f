"""Commands to relieve the plunger or shut the valve, lift and return the needle, heaters off.

A plunger is relieved and primed again; a pneumatic head's valve is shut
(`printctl.machine.job.dispensing`), and no E is sent to it. Opening it again is left to who comes
back: only when the tip is in place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import shut

_NOTHING_MM: Final = 1e-6
LOWERING_STEP_MM: Final = 2.0
"""Of the way down; a stop is looked for between two of them."""


@dataclass(frozen=True)
class Retreat:
    """Relieve the plunger or shut the valve, then lift straight up, the way that is free.

    A needle under pressure in the bath goes on writing, so that comes first. The shaft stands
    straight above the tip already, so straight up it meets nothing that it hasn't passed.
    ``relief_mm`` is plunger travel back (the ink's ``retract_ul`` over the syringe's area);
    ``prime_mm`` is pushed in addition on coming back from a pause. ``lift_mm`` upwards, or
    ``park_mm`` for a change of syringe, is ended by the top of the axis. ``others`` are those of
    the second and further heads, which have inks and syringes of their own.
    """

    relief_mm: float = 0.1
    relief_mm_s: float = 0.5
    lift_mm: float = 20.0
    lift_mm_s: float = 5.0
    park_mm: float = 60.0
    prime_mm: float = 0.0
    others: tuple[Retreat, ...] = ()

    def __post_init__(self) -> None:
        others = (Retreat(**one) if isinstance(one, dict) else one for one in self.others)
        object.__setattr__(self, "others", tuple(others))  # JSON knows no dataclass

    def of_head(self, number: int | None) -> Retreat:
        """Return that of one head; the first one's where no other is given."""
        return self.others[number - 1] if number and number <= len(self.others) else self

    def leave(self, at: Modal, printer: Printer, relieved_mm: float = 0.0) -> list[bytes]:
        """Return commands that leave ``at``; words that the job never gave are left out.

        ``relieved_mm`` is what the job itself has drawn back already, mm.
        """
        commands = shut(printer)
        relieves = not printer.pneumatic and self.relief_mm - relieved_mm > _NOTHING_MM
        if at.e is not None and relieves:
            commands.append(self.relieve_to(self.relieved_e(at.e, relieved_mm), printer))
        return commands + self.rise(at, printer, self.lift_mm)

    def relieved_e(self, e: float, relieved_mm: float = 0.0) -> float:
        """Return where the plunger stands once the needle has left ``e``, mm."""
        return e - max(0.0, self.relief_mm - relieved_mm)

    def relieve_to(self, e_mm: float, printer: Printer) -> bytes:
        """Return the command that draws the plunger back to ``e_mm``."""
        return _move("E", e_mm, self._relief_speed(printer))

    def rise(self, at: Modal, printer: Printer, by_mm: float) -> list[bytes]:
        """Return commands that go straight up from ``at``, at most to the top of the axis."""
        if at.z is None or by_mm <= 0:
            return []
        top = max(at.z, min(at.z + by_mm, printer.z_mm.high))
        return [_move("Z", top, self._lift_speed(printer))]

    def lower(self, at: Modal, printer: Printer, from_z: float) -> list[bytes]:
        """Return commands that come down (or up) to ``at`` from ``from_z``, mm, in short steps."""
        if at.z is None:
            return []
        steps = max(1, math.ceil((from_z - at.z) / LOWERING_STEP_MM - _NOTHING_MM))
        speed = self._lift_speed(printer)
        heights = [from_z + (at.z - from_z) * k / steps for k in range(1, steps)]
        return [_move("Z", height, speed) for height in (*heights, at.z)]

    def rejoin(self, at: Modal, printer: Printer, prime_mm: float = 0.0) -> list[bytes]:
        """Return commands that come back to ``at``: down, prime again, feed rate as it was.

        A pneumatic head's valve stays shut. ``prime_mm`` is pushed beyond where the plunger was;
        it is then counted as where it was.
        """
        commands = []
        if at.z is not None:
            commands.append(_move("Z", at.z, self._lift_speed(printer)))
        if at.e is not None and not printer.pneumatic:
            commands.append(_move("E", at.e + prime_mm, self._relief_speed(printer)))
            if prime_mm:
                commands.append(count_from(at.e))
        if at.f is not None:
            commands.append(b"G1 F%b" % f"{at.f:g}".encode())
        return commands

    def _relief_speed(self, printer: Printer) -> float:
        return min(self.relief_mm_s, printer.max_speed_mm_s.e)

    def _lift_speed(self, printer: Printer) -> float:
        return min(self.lift_mm_s, printer.max_speed_mm_s.z)


def heaters_off(printer: Printer) -> list[bytes]:
    """Return commands of the safe state: valves shut, ``safe_state_off``, then the heaters off.

    ``ink ...`` in ``safe_state_on`` keeps the tool's temperature, ``bath ...`` the bed's. Each of
    several heads is named: without a number it is the one in use that goes off.
    """
    others = (command.encode("ascii") for command in printer.safe_state_off)
    commands = list(dict.fromkeys([*shut(printer), *others]))
    if not any(item.startswith("ink") for item in printer.safe_state_on):
        count = printer.tool_count
        each = [b"M104 T%d S0" % number for number in range(count)]
        commands += each if count > 1 else [b"M104 S0"]
    if not any(item.startswith("bath") for item in printer.safe_state_on):
        commands.append(b"M140 S0")
    return commands


def count_from(e_mm: float) -> bytes:
    """Return the command that calls the plunger's place ``e_mm`` without moving it."""
    return b"G92 E%.5f" % e_mm


def _move(axis: str, to_mm: float, speed_mm_s: float) -> bytes:
    return f"G1 {axis}{to_mm:.5f} F{speed_mm_s * 60:.0f}".encode()
