"""Translate an Aerotech program file (A3200, Automation1) line by line to G-code words.

Read are the commands that such a job needs, one to a line, and nothing is guessed: what isn't
named here is handed on by its name, for the dry run to refuse.

================================================ ==============================================
line                                             read as
================================================ ==============================================
``G1 X1 Y2 A0.5 F20``                            the same with E for the plunger's axis
``G4 P0.03``, ``DWELL 0.03``                     G4 S0.03: seconds, not milliseconds
``G70``, ``G71``, ``G90``, ``G91``, ``G92``      G20, G21, and the same
``G75``, ``G76``                                 what F counts per: minutes, seconds
``WAIT MOVEDONE X Y``, ``WaitForMotionDone(X)``  M400
``VELOCITY ON``, ``G108``                        nothing: blending isn't modelled as theirs
``$DO[0].X=1``, ``DigitalOutputSet(X, 0, 1)``    nothing; reported with its name and words
``// ...``, ``' ...``, for an A3200 ``; ...``    a comment, which begins at a semicolon here
================================================ ==============================================

Sources: Automation1's help (help.aerotech.com/automation1, G-Code Programming), mecode's header.txt
and footer.txt, ORNL Slicer 2's aerobasic_writer.cpp. Without G75 and G76 seconds are taken, as with
the time base that mecode's header chooses. Not verified on a controller, and not modelled: its
look-ahead (Marlin's planner runs here, with the profile's speeds and accelerations), G0's separate
speeds for each axis, what an axis' own parameters limit.
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from sim.errors import GcodeError
from sim.gcode.reading.line import NOTHING, GcodeLine, TranslatedProgram, output_of

_NUMBER: Final = rb"[-+]?(?:\d+\.?\d*|\.\d+)"
_DWELL: Final = re.compile(rb"(?:G0?4\s+P|DWELL\s+)(" + _NUMBER + rb")", re.IGNORECASE)
_WAITS: Final = re.compile(
    rb"WAIT\s+MOVEDONE(?:\s+[A-Z])+|WAITFORMOTIONDONE\([^()]+\)", re.IGNORECASE
)
_BASE: Final = re.compile(rb"G7([56])", re.IGNORECASE)
_PLACED: Final = re.compile(rb"G92(?: +[A-Z]" + _NUMBER + rb")+")
_SAME: Final = {
    b"G70": b"G20",
    b"G71": b"G21",
    b"G90": b"G90",
    b"G91": b"G91",
    b"VELOCITY ON": NOTHING,
    b"G108": NOTHING,
}


def translate(gcode: bytes, printer: Printer) -> TranslatedProgram:
    """Put a whole file into the reader's words.

    Raises
    ------
    GcodeError
        When the profile doesn't say which controller it is for.
    """
    controller = printer.file_controller
    if controller is None:
        raise GcodeError(
            f"{printer.name} doesn't say which controller it is (file_controller: controller)"
        )
    letter = (controller.plunger_axis or "").encode()
    named: list[tuple[int, GcodeLine]] = []
    bases: list[tuple[int, bool]] = []
    seen = line = 0
    # A plain move is left as it is, but for the plunger's letter: nearly all lines are such.
    words = rb"(?: +[XYZF" + letter + rb"]" + _NUMBER + rb")+"
    other = re.compile(rb"^(?!G[01]" + words + rb"[ \t\r]*$)[^\n]+", re.MULTILINE)
    comment = re.compile(rb"//|'|;" if controller.controller == "a3200" else rb"//")

    def plain(match: re.Match[bytes]) -> bytes:
        nonlocal seen, line
        line += gcode.count(b"\n", seen, match.start())
        seen = match.start()
        begins = comment.search(match[0])
        text = match[0][: begins.start()] if begins else match[0]
        remark = b";" + match[0][begins.end() :] if begins else b""
        text = text.strip()
        base = _BASE.fullmatch(text)
        if base:
            bases.append((line + 1, base[1] == b"6"))
        word = b"" if not text else NOTHING if base else _plain(text, words)
        if word is None:
            named.append((line + 1, _named(text.decode("ascii", "replace"), match[0].strip())))
            word = NOTHING
        return word + remark

    result = other.sub(plain, gcode)
    if letter and letter != b"E":
        moves = re.compile(rb"^(G(?:[01]|92)(?: +[XYZF]" + _NUMBER + rb")* +)" + letter, re.M)
        result = moves.sub(rb"\1E", result)
    return TranslatedProgram(result, tuple(named), tuple(bases))


def _plain(text: bytes, move_words: bytes) -> bytes | None:
    """One command in the reader's words; None where it has none."""
    upper = b" ".join(text.upper().split())
    if upper in _SAME:
        return _SAME[upper]
    if re.fullmatch(rb"G[01]" + move_words, text) or _PLACED.fullmatch(text):
        return text
    dwell = _DWELL.fullmatch(text)
    if dwell:
        return b"G4 S" + dwell[1]
    return b"M400" if _WAITS.fullmatch(text) else None


def _named(command: str, text: bytes) -> GcodeLine:
    name, words = output_of(command) or (command.split()[0].upper(), {"TEXT": command})
    return GcodeLine(name, {}, text, words)
