"""Decide if two G-code lines may be sent to Marlin together; withhold the second's last bytes.

Either two lines leave in *one* write and only when nothing is in flight; the next leave when both
are acknowledged. So a reply's way back (a USB adapter holds it for 1 to 16 ms) is paid for once in
two lines. Or (`Pairing.withholds`) the second leaves but for its last two bytes, which follow once
the first is acknowledged, with the text of the next line behind them. So one line alone is ever
whole at the printer, and the time of a line on the wire is saved: the better where replies come
back sooner than a line takes to leave.

A sliding window would be simpler and isn't safe. Marlin checks a line as soon as it is whole,
says what is wrong, and then empties its receive buffer; whatever of the next line arrives later
is run as a line of its own, without number and checksum. The tail ``G1 X...`` is a move. Of two
lines in one write the second's command letter is in the buffer some ten bytes after the first
one's end, while the words of the refusal alone take the time of 38 bytes or more: what is cut
off begins behind the letter and is an unknown command. Hence:

- both lines are plain moves: no G, M or T behind the first letter that a tail could begin with;
- both frames, and what may be sent behind them at any time (the question, M112), fit into the
  receive buffer, else one line leaves alone;
- after a doubt `Timing.calm_lines` leave one by one.

Withheld are the last digit of the checksum and the line end. A line end of anything else (the
question, a stop, another program, a host that comes after this one's death) makes it a line with
a wrong checksum, which is refused. So does the link itself after an error: nothing further is run.

This counts on a firmware that writes its replies without a buffer (Marlin on AVR; recorded), or
on a line with a check of its own (USB as far as the processor), where nothing is refused. Where
neither holds a tail that is a move may be run; its ok is one too many, and the position is
compared before the print goes on.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from firmware_profiles.families.timing import QUESTION

_PLAIN_MOVE: Final = re.compile(rb"G[01](?: [XYZEF]-?[0-9.]+)+")
_MARGIN_BYTES: Final = len(QUESTION) + len(b"\nM112\n")
_WITHHELD: Final = 2


@dataclass(frozen=True)
class Pairing:
    """The rule by which two lines leave together.

    Attributes
    ----------
    buffer_bytes : int
        The firmware's receive buffer (profile: receive_buffer_bytes); it holds one byte less.
    withholds : bool
        Whether the second line's last bytes wait for the answer to the first.
    """

    buffer_bytes: int
    withholds: bool = False

    def allows(self, first: bytes, second: bytes, bytes_in_all: int) -> bool:
        """Whether two commands may leave together, whose frames are ``bytes_in_all`` long."""
        fits = bytes_in_all + _MARGIN_BYTES < self.buffer_bytes
        return bool(fits and _PLAIN_MOVE.fullmatch(first) and _PLAIN_MOVE.fullmatch(second))

    def withheld(self, frame: bytes) -> int:
        """Return how many of the last bytes of the second line's frame are kept back.

        Without digits a checksum reads 0: where it is that, nothing would be missed.
        """
        return _WITHHELD if self.withholds and not frame.endswith(b"*0\n") else 0
