"""Translate an Aerotech program file (A3200, Automation1) line by line to G-code words.

Read are the commands that such a job needs, one to a line, and nothing is guessed: what isn't
named here is handed on by its name, for the dry run to refuse.

================================================ ==============================================
line                                             read as
================================================ ==============================================
``G1 X1 Y2 A0.5 F20``                            the same with E for the plunger's axis, Z for the
                                                 vertical one; other vertical axes left out
``G4 P0.03``, ``DWELL 0.03``                     G4 S0.03: seconds, not milliseconds
``G70``, ``G71``, ``G90``, ``G91``, ``G92``      G20, G21, and the same
``G75``, ``G76``                                 what F counts per: minutes, seconds
``WAIT MOVEDONE X Y``, ``WaitForMotionDone(X)``  M400; refused where they leave an axis out
``VELOCITY ON``, ``G108``                        nothing: blending isn't modelled as theirs
``$DO[0].X=1``, ``DigitalOutputSet(X, 0, 1)``    nothing; reported with its name and words
``BRAKE Aa 0``, ``DriveBrakeOff(Aa)``            the same
the profile's ``sets_pressure``, whole           the same, with head and pressure
the profile's ``begins`` and ``ends``            nothing
its ``enables``, right before the valve opens    nothing; refused elsewhere
``// ...``, ``' ...``, for an A3200 ``; ...``    a comment, which begins at a semicolon here
================================================ ==============================================

Sources: Automation1's help (help.aerotech.com/automation1, G-Code Programming), mecode's header.txt
and footer.txt, ORNL Slicer 2's aerobasic_writer.cpp. A file that moves before it has said modes,
units and places is refused: they stay as they are between programs, and a reset takes them from
parameters (DefaultTaskTargetMode: the same help, Motion Setup Functions). Not verified on a
controller, and not modelled: its look-ahead (Marlin's planner runs here, with the profile's speeds
and accelerations), G0's separate speeds for each axis, what an axis' own parameters limit.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from firmware_profiles.strict_model import PRESSURE_UNITS
from gcode.errors import GcodeError, LineError
from gcode.program.valve import SETS_PRESSURE
from gcode.reading.line import NOTHING, GcodeLine, TranslatedProgram, output_of, refusal

_NUMBER: Final = rb"[-+]?(?:\d+\.?\d*|\.\d+)"
_DWELL: Final = re.compile(rb"(?:G0?4\s+P|DWELL\s+)(" + _NUMBER + rb")", re.IGNORECASE)
_WAITS: Final = re.compile(
    rb"WAIT\s+MOVEDONE((?:\s+[A-Z])+)|WAITFORMOTIONDONE\(([][, \w]+)\)", re.IGNORECASE
)
_BASE: Final = re.compile(rb"G7([56])", re.IGNORECASE)
_SWITCH_BYTES: Final = 200
"""Behind a line, looked through for a valve's command: more than any has."""
_PLACED: Final = re.compile(rb"G92(?: +[A-Z]" + _NUMBER + rb")+")
_SAME: Final = {
    b"G70": b"G20",
    b"G71": b"G21",
    b"G90": b"G90",
    b"G91": b"G91",
    b"VELOCITY ON": NOTHING,
    b"G108": NOTHING,
}


def translate(gcode: bytes, printer: Printer, head: int = 0) -> TranslatedProgram:
    """Put a whole file into the reader's words, Z the vertical axis of one head.

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
    gcode, named = _without_pressures(gcode, printer)
    letter = (controller.plunger_axis or "").encode()
    axes = "".join(printer.z_axes).encode()
    enables = {air.enables.encode(): air.opens for air in printer.airs if air.enables}
    begins, ends = ({one.encode() for one in of} for of in (controller.begins, controller.ends))
    own = {*enables, *begins, *ends, SETS_PRESSURE.encode()}
    last_move = max(gcode.rfind(b"\nG0 "), gcode.rfind(b"\nG1 "))
    dialect = family_of(printer).dialect(printer)
    blending, blends = dialect.modes[-1], list[int]()
    bases: list[tuple[int, bool]] = []
    refused: list[tuple[int, LineError]] = []
    movable = {b"%c" % axis for axis in b"XY" + axes + letter}
    seen = line = 0
    # A plain move is left as it is, but for the plunger's letter: nearly all lines are such.
    words = rb"(?: +[XYF" + axes + letter + rb"]" + _NUMBER + rb")+"
    other = re.compile(rb"^(?!G[01]" + words + rb"[ \t\r]*$)[^\n]+", re.MULTILINE)
    comment = re.compile(rb"//|'|;" if controller.controller == "a3200" else rb"//")

    def plain(match: re.Match[bytes]) -> bytes:
        nonlocal seen, line
        line += gcode.count(b"\n", seen, match.start())
        seen = match.start()
        found = comment.search(match[0])
        text = match[0][: found.start()] if found else match[0]
        remark = b";" + match[0][found.end() :] if found else b""
        text = text.strip()
        if text in enables and b"\n" in gcode:  # it may let the axis' brake, the valve, go
            after = gcode[match.end() : match.end() + _SWITCH_BYTES].lstrip().partition(b"\n")[0]
            after = comment.split(after, maxsplit=1)[0]
            if output_of(after.decode("ascii", "replace")) != output_of(enables[text]):
                reason = (
                    f"may open the valve by itself, and {enables[text]!r} isn't the next line; "
                    "write that there, or take this line out"
                )
                refused.append((line + 1, refusal("ambiguous", text, reason)))
        if text in ends - begins and match.start() < last_move:
            reason = "stands behind the last move alone (file_controller: ends); take it out here"
            refused.append((line + 1, refusal("ambiguous", text, reason)))
        waits = _WAITS.fullmatch(text)
        if waits and not movable <= set(re.findall(rb"\w+", (waits[1] or waits[2]).upper())):
            reason = f"waits while another axis may still move; name them all: {dialect.waits}"
            refused.append((line + 1, refusal("ambiguous", text, reason)))
        if b" ".join(text.upper().split()) == blending.encode():
            blends.append(line + 1)
        base = _BASE.fullmatch(text)
        if base:
            bases.append((line + 1, base[1] == b"6"))
        word = b"" if not text else NOTHING if base or text in own else _plain(text, words)
        if word is None:
            named.append((line + 1, _named(text.decode("ascii", "replace"), match[0].strip())))
            word = NOTHING
        return word + remark

    result = other.sub(plain, gcode)
    if b"\n" in gcode:  # a single line is read by itself
        first = {"G76 or G75": [at for at, _ in bases], blending: blends}
        refused += _undeclared(result, movable, first)
    letters = dict.fromkeys(axes, b"") | {ord(printer.z_axes[head]): b"Z"}
    letters |= dict.fromkeys(letter, b"E")
    if letters != {ord("Z"): b"Z"}:
        result = _with_letters(result, letters)
    return TranslatedProgram(result, tuple(named), tuple(bases), tuple(refused))


def _undeclared(
    gcode: bytes, axes: Collection[bytes], lines: Mapping[str, Sequence[int]]
) -> list[tuple[int, LineError]]:
    """Refuse the first move before which a mode, a unit or an axis' place isn't declared.

    ``gcode`` is in the reader's words with the axes' own letters; ``lines`` says where it has what
    those words haven't.
    """
    first = re.search(rb"^G[01] ", gcode, re.M)
    if first is None:
        return []
    before = gcode[: first.start()]
    said = {
        "G90 or G91": re.search(rb"^G9[01]\b", before, re.M),
        "G71 or G70": re.search(rb"^G2[01]\b", before, re.M),
        **{what: at and at[0] <= before.count(b"\n") for what, at in lines.items()},
    }
    missing = [words for words, found in said.items() if not found]
    at = first.start() if missing else len(gcode)
    for axis in sorted(axes):
        for word in re.finditer(b" %b[-+.\\d]" % axis, gcode):
            begin = gcode.rfind(b"\n", 0, word.start()) + 1
            code, in_comment = gcode[begin : begin + 2], b";" in gcode[begin : word.start()]
            if code in (b"G0", b"G1") and not in_comment:
                missing.append(f"G92 {axis.decode()}... (its place)")
                at = min(at, begin)
            if code in (b"G0", b"G1", b"G9") and not in_comment:
                break
    if not missing:
        return []
    text = gcode[at:].partition(b"\n")[0]
    reason = (
        f"moves without {', '.join(missing)} in the lines before: the controller would go on from "
        "what the program before left, or its own defaults; say each in a line of its own"
    )
    return [(gcode.count(b"\n", 0, at) + 1, refusal("undeclared", text, reason))]


def _with_letters(gcode: bytes, letters: Mapping[int, bytes]) -> bytes:
    """Give the axes other letters; words whose letter is empty are left out."""
    word = re.compile(rb" +([" + bytes(letters) + rb"])(" + _NUMBER + rb")")

    def renamed(match: re.Match[bytes]) -> bytes:
        letter = letters[match[1][0]]
        return b" " + letter + match[2] if letter else b""

    def line(match: re.Match[bytes]) -> bytes:
        code, rest = match[1], word.sub(renamed, match[2])
        return code + rest if rest or code != b"G92" else NOTHING

    return re.sub(rb"^(G(?:[01]|92))((?: +[A-Z]" + _NUMBER + rb")+)", line, gcode, flags=re.M)


def _without_pressures(gcode: bytes, printer: Printer) -> tuple[bytes, list[tuple[int, GcodeLine]]]:
    """Take out the lines that set a head's pressure; what they set."""
    found: list[tuple[int, GcodeLine]] = []
    alone = b"\n" not in gcode  # a single line is read by itself
    for number, air in enumerate(printer.airs):
        lines = [_pattern(line) for line in air.sets_pressure]
        if not lines:
            continue
        whole = rb"|".join(lines) if alone else rb"[ \t]*\r?\n".join(lines)
        pattern = re.compile(rb"^[ \t]*(?:" + whole + rb")[ \t]*(?=\r?$)", re.M)
        unit = re.findall(r"\{(\w+)\}", " ".join(air.sets_pressure))[0]
        for match in pattern.finditer(gcode):
            values = [text for text in match.groups() if text is not None]
            if values:
                kpa = float(values[0]) * PRESSURE_UNITS[unit]
                words = {"HEAD": str(number), "KPA": f"{kpa:.6g}"}
                line = gcode.count(b"\n", 0, match.start()) + 1
                found.append((line, GcodeLine(SETS_PRESSURE, {}, match[0].strip(), words)))
        gcode = pattern.sub(
            SETS_PRESSURE.encode() + b"\n" * (0 if alone else len(lines) - 1), gcode
        )
    return gcode, found


def _pattern(line: str) -> bytes:
    """Match one line of a profile, a number in the place of its value."""
    parts = re.split(r"\{\w+\}", line)
    return (rb"(" + _NUMBER + rb")").join(re.escape(part).encode() for part in parts)


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
