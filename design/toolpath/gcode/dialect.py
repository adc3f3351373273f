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
- Aerotech, not verified on a machine. Its file is loaded by the controller's own software.
  Automation1's help (help.aerotech.com/automation1, "G-Code Programming"): G90; G76, time in
  seconds, so that F is mm/s; G0 moves each axis at its own rate, not along a line, so travels are
  G1 here; ``//`` begins a comment. A3200: mecode's own program text (github.com/jminardi/mecode,
  header.txt and footer.txt): ``$DO0.0=0``, ``G4 P0.15`` in seconds; ORNL Slicer 2,
  aerobasic_writer.cpp: ``VELOCITY ON`` keeps the head from stopping at each move's end,
  ``$DO[0].X=1``, F in mm/s; G71 and G92 as in the programs of others. ``;`` begins a comment in
  mecode's files, but would part two statements in AeroScript, so it isn't used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from design.errors import ToolpathError
from design.toolpath.gcode.numbers import FEED_DECIMALS, WORDS
from firmware_profiles import Aerotech, Printer

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
    modes : tuple of str
        Units and absolute places.
    absolute_e : tuple of str
        What a plunger needs beside them.
    waits : str
        Waits until the motors stand.
    words : bytes
        Letters of X, Y, Z, the plunger's axis, feed and dwell.
    feed_s : float, s
        What F is told per: a minute or a second.
    feed_decimals, dwell_decimals : int
        Digits of F, and of a dwell, after the point; 0 for a dwell in whole ms, 3 for one in s.
    travels : int
        Number of the G command of a travel.
    comment : str
        What begins a comment.
    counts_anew : bool
        Whether E is counted anew before float32 rounds it.
    """

    idle_timeout: str = ""
    cold_extrusion: str = ""
    clean: tuple[str, ...] = ("M220 S100", "M221 S100", "M200 D0")
    declares: str = ""
    zero_is_off: bool = True
    of_each_head: tuple[str, ...] = ()
    of_others: tuple[str, ...] = ()
    modes: tuple[str, ...] = ("G21", "G90")
    absolute_e: tuple[str, ...] = ("M82",)
    waits: str = "M400"
    words: bytes = WORDS
    feed_s: float = 60.0
    feed_decimals: int = FEED_DECIMALS
    dwell_decimals: int = 0
    travels: int = 0
    comment: str = ";"
    counts_anew: bool = True

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
            return [printer.pneumatic.closes, *self.modes, *clean]
        cold = [self.cold_extrusion] if self.cold_extrusion else []
        return [*self.modes, *self.absolute_e, *self.clean, *cold]

    def _heads(self, printer: Printer) -> list[str]:
        """The firmware adds no offset of its own, and takes each head's E as it is."""
        numbers = range(len(printer.heads))
        return [
            *(text.format(head=number) for number in numbers for text in self.of_each_head),
            *(text.format(head=number) for number in numbers[1:] for text in self.of_others),
        ]

    def footer(self) -> list[str]:
        """Lines after the last move: wait until it has ended."""
        return [self.waits]

    def dwell(self, seconds: float) -> str:
        """A pause, rounded up to whole milliseconds."""
        milliseconds = math.ceil(seconds * 1e3)
        return f"G4 P{milliseconds / 10**self.dwell_decimals:g}"


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
    "aerotech": Dialect(
        clean=(),
        modes=("G71", "G76", "G90"),
        absolute_e=(),
        feed_s=1.0,
        feed_decimals=5,
        dwell_decimals=3,
        travels=1,
        comment="//",
        counts_anew=False,
    ),
}
"""By the profile's ``firmware``; an Aerotech's is completed by its controller."""

_BLENDING: Final = {"a3200": "VELOCITY ON", "automation1": "G108"}
_WAITS: Final = {"a3200": "WAIT MOVEDONE {}", "automation1": "WaitForMotionDone([{}])"}


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
    found = DIALECTS[printer.firmware]
    if printer.firmware != "aerotech":
        return found
    if printer.aerotech is None:
        raise ToolpathError(
            f"profile {printer.name!r} doesn't say which Aerotech controller it is for; give it "
            "(aerotech: {controller: a3200})"
        )
    return _completed(found, printer.aerotech)


def _completed(dialect: Dialect, aerotech: Aerotech) -> Dialect:
    """Blending and waiting in the controller's language, and the plunger's own letter."""
    letter = aerotech.plunger_axis or ""
    axes = ["X", "Y", "Z", *letter]
    between = " " if aerotech.controller == "a3200" else ", "
    return replace(
        dialect,
        modes=(*dialect.modes, _BLENDING[aerotech.controller]),
        waits=_WAITS[aerotech.controller].format(between.join(axes)),
        words=WORDS.replace(b"E", (letter or "E").encode()),
    )
