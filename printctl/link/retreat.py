"""How the needle leaves the bath in a controlled stop or a pause, and how it comes back."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Printer
from printctl.link.modal import Modal


@dataclass(frozen=True)
class Retreat:
    """Relieve the plunger, then lift straight up: the way by which the needle is free.

    A needle under pressure in the bath goes on writing, so the plunger comes first.

    Attributes
    ----------
    relief_mm : float, mm
        Plunger travel back (the ink's ``retract_ul`` over the syringe's area).
    relief_mm_s : float, mm/s
    lift_mm : float, mm
        Upwards, ended by the top of the axis.
    lift_mm_s : float, mm/s
    """

    relief_mm: float = 0.1
    relief_mm_s: float = 0.5
    lift_mm: float = 20.0
    lift_mm_s: float = 5.0

    def leave(self, at: Modal, printer: Printer) -> list[bytes]:
        """Commands that leave ``at``; words that the job never gave are left out."""
        commands = []
        if at.e is not None and self.relief_mm > 0:
            commands.append(_move("E", at.e - self.relief_mm, self._relief_speed(printer)))
        if at.z is not None and self.lift_mm > 0:
            top = max(at.z, min(at.z + self.lift_mm, printer.z_mm.high))
            commands.append(_move("Z", top, self._lift_speed(printer)))
        return commands

    def rejoin(self, at: Modal, printer: Printer) -> list[bytes]:
        """Commands that come back to ``at``: down, prime again, feed rate as it was."""
        commands = []
        if at.z is not None:
            commands.append(_move("Z", at.z, self._lift_speed(printer)))
        if at.e is not None:
            commands.append(_move("E", at.e, self._relief_speed(printer)))
        if at.f is not None:
            commands.append(b"G1 F%b" % f"{at.f:g}".encode())
        return commands

    def _relief_speed(self, printer: Printer) -> float:
        return min(self.relief_mm_s, printer.max_speed_mm_s.e)

    def _lift_speed(self, printer: Printer) -> float:
        return min(self.lift_mm_s, printer.max_speed_mm_s.z)


def heaters_off(printer: Printer) -> list[bytes]:
    """Commands that switch heaters off, but for what the profile says must stay on.

    ``ink ...`` in ``safe_state_on`` keeps the tool's temperature, ``bath ...`` the bed's.
    """
    commands = []
    if not any(item.startswith("ink") for item in printer.safe_state_on):
        commands.append(b"M104 S0")
    if not any(item.startswith("bath") for item in printer.safe_state_on):
        commands.append(b"M140 S0")
    return commands


def _move(axis: str, to_mm: float, speed_mm_s: float) -> bytes:
    return f"G1 {axis}{to_mm:.5f} F{speed_mm_s * 60:.0f}".encode()
