"""What differs between firmwares in a job: a row of a table for each family.

Moves (G0, G1), G4 P in milliseconds, G92 E, G21, G90, M82 and M400 are common to all. Sources:

- Marlin 2: https://marlinfw.org/meta/gcode/ (M85, M302).
- Prusa-Firmware, ``Marlin_main.cpp``: M85 as Marlin's; M302 knows S alone.
- RepRapFirmware 3.5, ``GCodes2.cpp``: M302 P1 as Marlin's; M85 is taken and does nothing, M84 S
  lowers the idle motors' current only; G92 X Y Z makes the axes count as homed
  (``GCodes::SetPositions``).
- Klipper, ``idle_timeout.py``, ``force_move.py``, ``gcode_move.py``, ``kinematics/extruder.py``:
  SET_IDLE_TIMEOUT; cold extrusion is allowed in printer.cfg alone (``min_extrude_temp``); G92 X Y Z
  moves the origin and homes nothing, where SET_KINEMATIC_POSITION (section ``force_move``) says
  where the tip is. SET_GCODE_OFFSET adds to every place until it is set to 0.
- M220 and M221 scale feed and plunger, M200 makes E a volume: what somebody set at the panel or an
  earlier job left goes on silently. All families know the first two, all but Klipper M200 D0
  (linear E).
- Several heads: M218 T (https://marlinfw.org/docs/gcode/M218.html) and G10 P
  (https://docs.duet3d.com/User_manual/Reference/Gcodes/G10) give the firmware an offset that it
  adds at each change; ours is in the places already. M221 and M200 hold for one head each.
  Klipper's ACTIVATE_EXTRUDER has no offset; a macro named T0 may have.
- Smoothieware, https://smoothieware.org/supported-g-codes: no timeout; extrudes cold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.errors import ToolpathError
from firmware_profiles import Printer

_PLUNGER_S: Final = ("M221", "M200")

Place = tuple[str, str, str]
"""X, Y and Z as text, mm."""


@dataclass(frozen=True)
class Dialect:
    """One family's own words.

    Attributes
    ----------
    idle_timeout : str
        The firmware's own switch-off when the host is silent, ``{seconds}``; empty where a job
        can't set it.
    cold_extrusion : str
        Lets the plunger move without a hot end; empty where that is the configuration's.
    clean : tuple of str
        Take back what an earlier job or the panel may have left: factors of feed and flow, E as
        a volume, an offset of every place.
    declares : str
        Tells where the tip stands, ``{x} {y} {z}``; empty where G92 does.
    zero_is_off : bool
        Whether a timeout of 0 s may be written, to switch it off.
    of_each_head, of_others : tuple of str
        What each of several heads is told, ``{head}``; what all but the first are: no offset.
    """

    idle_timeout: str = ""
    cold_extrusion: str = ""
    clean: tuple[str, ...] = ("M220 S100", "M221 S100", "M200 D0")
    declares: str = ""
    zero_is_off: bool = True
    of_each_head: tuple[str, ...] = ()
    of_others: tuple[str, ...] = ()

    def header(self, printer: Printer, start: Place | None = None) -> list[str]:
        """Lines before the first move: timeout, units, absolute positions, absolute linear E.

        No homing: the needle may stand in the bath. ``start`` is where the tip stands, where that
        is known and G92 doesn't tell it.
        """
        seconds = printer.idle_timeout_s
        timed = self.idle_timeout and (seconds > 0 or self.zero_is_off)
        placed = self.declares and start is not None
        x, y, z = start or ("", "", "")
        return [
            *([self.idle_timeout.format(seconds=f"{seconds:.0f}")] if timed else []),
            *self._dispenser(printer),
            *self._heads(printer),
            *([self.declares.format(x=x, y=y, z=z)] if placed else []),
        ]

    def _dispenser(self, printer: Printer) -> list[str]:
        """Units, modes, and what makes the dispenser ready: a plunger's E, or a closed valve."""
        if printer.pneumatic:
            clean = [line for line in self.clean if not line.startswith(_PLUNGER_S)]
            return [printer.pneumatic.closes, "G21", "G90", *clean]
        cold = [self.cold_extrusion] if self.cold_extrusion else []
        return ["G21", "G90", "M82", *self.clean, *cold]

    def _heads(self, printer: Printer) -> list[str]:
        """The firmware adds no offset of its own, and takes each head's E as it is."""
        numbers = range(len(printer.heads))
        return [
            *(text.format(head=number) for number in numbers for text in self.of_each_head),
            *(text.format(head=number) for number in numbers[1:] for text in self.of_others),
        ]

    def footer(self) -> list[str]:
        """Lines after the last move: wait until it has ended."""
        return ["M400"]


DIALECTS: Final[dict[str, Dialect]] = {
    "marlin": Dialect(
        "M85 S{seconds}",
        "M302 P1",
        of_others=("M218 T{head} X0 Y0 Z0", "M221 T{head} S100", "M200 T{head} D0"),
    ),
    "prusa": Dialect("M85 S{seconds}", "M302 S0"),
    "reprapfirmware": Dialect(
        cold_extrusion="M302 P1", of_each_head=("G10 P{head} X0 Y0 Z0", "M221 D{head} S100")
    ),
    "klipper": Dialect(
        "SET_IDLE_TIMEOUT TIMEOUT={seconds}",
        clean=("M220 S100", "M221 S100", "SET_GCODE_OFFSET X=0 Y=0 Z=0"),
        declares="SET_KINEMATIC_POSITION X={x} Y={y} Z={z}",
        zero_is_off=False,
    ),
    "smoothieware": Dialect(),
}


def dialect_of(printer: Printer) -> Dialect:
    """Dialect of the printer's firmware.

    Raises
    ------
    ToolpathError
        When there is none.
    """
    if printer.firmware not in DIALECTS:
        raise ToolpathError(
            f"no G-code writer for firmware {printer.firmware!r} (profile {printer.name!r}); "
            f"there is one for: {', '.join(sorted(DIALECTS))}"
        )
    return DIALECTS[printer.firmware]
