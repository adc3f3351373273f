"""Which commands a person may type: what would break the link's count or position is refused."""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from printctl.link.errors import Refused
from printctl.link.heads import head_chosen

CODE: Final = re.compile(r"([A-Z])0*(\d+)")
_REFUSED: Final = frozenset({"M110", "M112", "M83", "G91", "G92", "G20", "M18", "M84", "M410"})
"""Besides another count or frame: what takes the motors' power or throws moves away."""


def by_hand(typed: str, printer: Printer) -> str:
    """The command as it is sent.

    Parameters
    ----------
    typed : str
    printer : Printer

    Raises
    ------
    ValueError
        When it can't be sent at all: empty, not ASCII, or with a checksum of its own.
    Refused
    """
    text = typed.strip()
    if not text.isascii() or not text.isprintable() or "*" in text or not text:
        raise ValueError(text)
    code = CODE.match(text.upper())  # "g092E0" is read as G92 by a firmware
    if head_chosen(text.upper().encode()) is not None and printer.heads:
        raise Refused(
            f"{text} would take another head than the job's; its syringe is changed by "
            "`printctl reload RUN --head`, which takes it and gives it back"
        )
    if code and (code[1] + code[2] in _REFUSED or code[1] == "N"):
        raise Refused(f"{text} isn't for manual use: it would break the link's count or position")
    return text
