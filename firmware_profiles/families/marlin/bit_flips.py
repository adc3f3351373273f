"""Zero-pad M codes (M0113) that one flipped bit would turn into a Marlin stop or renumbering.

Marlin's emergency parser reads the raw bytes, before any checksum: ``M113`` with one bit flipped is
``M112``, a halt, and ``M400`` is ``M410``, which throws away what the planner holds. And a line in
which ``M110`` stands may have any number: an ``M114`` that becomes one, with a second flip that its
checksum doesn't show, renumbers. A zero before the digits (``M0113``) leaves the command what it is
and puts each of these two flips further away.
"""

from __future__ import annotations

import re
from typing import Final

_FEARED: Final = (b"110", b"112", b"410")
_LONGEST: Final = 40
"""Bytes; a longer line (a text for a display) is left alone, it might outgrow the firmware's."""
_CODE: Final = re.compile(rb"M(\d{3})(?!\d)")


def guard_command(command: bytes) -> bytes:
    """The command, its number with a zero before where one flipped bit would make it a stop."""
    match = _CODE.match(command)
    if match is None or len(command) > _LONGEST or match[1] in _FEARED:
        return command
    near = any(_flips(match[1], feared) == 1 for feared in _FEARED)
    return b"M0" + command[1:] if near else command


def _flips(one: bytes, other: bytes) -> int:
    return sum((a ^ b).bit_count() for a, b in zip(one, other, strict=True))
