"""G-code that a firmware family needs in a job: header, footer, dwell, units, comment style.

Moves (G0, G1), G4 P in milliseconds, G92 E, G21, G90, M82 and M400 are common to all. M220 and M221
scale feed and plunger, M200 makes E a volume: what somebody set at the panel or an earlier job left
goes on silently. All families know the first two, all but Klipper M200 D0 (linear E). Several
heads: M218 T (https://marlinfw.org/docs/gcode/M218.html) and G10 P
(https://docs.duet3d.com/User_manual/Reference/Gcodes/G10) give the firmware an offset that it adds
at each change; ours is in the places already. M221 and M200 hold for one head each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from firmware_profiles.printers import Printer

_PLUNGER_S: Final = ("M221", "M200")
FEED_DECIMALS: Final = 3
WORDS: Final = b"XYZEFP"
"""Letters of a move's words, in the order in which they are written."""

Place = tuple[str, str, str]
"""X, Y and Z as text, mm."""


@dataclass(frozen=True)
class Dialect:
    """G-code dialect of one firmware family.

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
    begins, ends : tuple of str
        The lab's own lines before all others and behind them.
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
    begins: tuple[str, ...] = ()
    ends: tuple[str, ...] = ()

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
            *self.begins,
            *([self.idle_timeout.format(seconds=f"{seconds:.0f}")] if timed else []),
            *self._dispenser(printer),
            *self._heads(printer),
            *([self.declares.format(x=x, y=y, z=z)] if placed else []),
        ]

    def _dispenser(self, printer: Printer) -> list[str]:
        """Units, modes, and what makes the dispenser ready: a plunger's E, or closed valves."""
        if printer.airs:
            clean = [line for line in self.clean if not line.startswith(_PLUNGER_S)]
            return [*(head.closes for head in printer.airs), *self.modes, *clean]
        cold = [self.cold_extrusion] if self.cold_extrusion else []
        return [*self.modes, *self.absolute_e, *self.clean, *cold]

    def _heads(self, printer: Printer) -> list[str]:
        """The firmware adds no offset of its own, and takes each head's E as it is."""
        numbers = range(printer.tool_count if printer.heads and not printer.airs else 0)
        return [
            *(text.format(head=number) for number in numbers for text in self.of_each_head),
            *(text.format(head=number) for number in numbers[1:] for text in self.of_others),
        ]

    def footer(self) -> list[str]:
        """Lines after the last move: wait until it has ended."""
        return [self.waits, *self.ends]

    def words_of(self, z_axis: str) -> bytes:
        """Letters of a move's words where the vertical axis has this letter."""
        return self.words.replace(b"Z", z_axis.encode())

    def dwell(self, seconds: float) -> str:
        """A pause, rounded up to whole milliseconds."""
        milliseconds = math.ceil(seconds * 1e3)
        return f"G4 P{milliseconds / 10**self.dwell_decimals:g}"


def same_dialect(dialect: Dialect) -> Callable[[Printer], Dialect]:
    """Give every printer of a family the same dialect."""
    return lambda printer: dialect
