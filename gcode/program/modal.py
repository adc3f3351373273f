"""Interpret a G-code line in the modal state left by earlier lines, as Marlin does."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import MOST_HEADS
from firmware_profiles.families.grammar import E_RULES, ERule
from gcode.motion.state import Record, Records
from kernels import jit

WORDS: Final = np.dtype(
    [
        ("letter", "i8"),  # of the command: G, M or T; 0 where there is none
        ("number", "i8"),  # after it; -1 where there is none
        ("begin", "i8"),  # index of the command's letter, after line number and blanks
        ("numbered", "i8"),  # the line number N; -1 without one
        ("seen", "i8"),  # bit 0 for A … bit 25 for Z: the letter stands in the line
        ("valued", "i8"),  # and a number follows it
        ("value", "f8", (26,)),
    ],
    align=True,
)
"""One line, taken apart."""

_POWERS = tuple(10.0**n for n in range(19))
_MOST_DIGITS = 17

_A, _Z = ord("A"), ord("Z")
_BLANK, _PLUS, _MINUS, _POINT = ord(" "), ord("+"), ord("-"), ord(".")
_ZERO, _NINE, _STAR = ord("0"), ord("9"), ord("*")
_G, _M, _N, _T = ord("G"), ord("M"), ord("N"), ord("T")
_TEXT_CODES = (23, 28, 30, 117, 118, 928)
_CODE_MASK = 0xFFFF
_REST = (_PLUS, _MINUS, _POINT)


@jit
def is_digit(char: int) -> bool:
    """Whether a byte is a decimal digit."""
    return _ZERO <= char <= _NINE


@jit
def number_at(text: bytes, at: int, end: int) -> tuple[float, int]:
    """Decimal number that begins at ``at``, and the index after it.

    No exponent: in G-code an E begins the next word. The index equals ``at`` where no number
    stands. Exact to the last bit up to 15 digits; digits beyond 17 are dropped.
    """
    i = at
    negative = False
    if i < end and (text[i] == _MINUS or text[i] == _PLUS):
        negative = text[i] == _MINUS
        i += 1
    mantissa = 0
    digits = 0
    decimals = 0
    whole = 0
    while i < end and is_digit(text[i]):
        if digits < _MOST_DIGITS:
            mantissa = mantissa * 10 + (text[i] - _ZERO)
            digits += 1 if mantissa > 0 else 0
        else:
            decimals -= 1
        whole += 1
        i += 1
    if i < end and text[i] == _POINT:
        i += 1
        while i < end and is_digit(text[i]):
            if digits < _MOST_DIGITS and decimals < 18:
                mantissa = mantissa * 10 + (text[i] - _ZERO)
                digits += 1 if mantissa > 0 else 0
                decimals += 1
            whole += 1
            i += 1
    if whole == 0:
        return 0.0, at
    value = float(mantissa)
    if decimals > 0:
        value /= _POWERS[decimals]
    elif decimals < 0:
        value *= _POWERS[min(-decimals, 18)]
    return (-value if negative else value), i


@jit
def _skip_blanks(text: bytes, at: int, end: int) -> int:
    while at < end and text[at] == _BLANK:
        at += 1
    return at


@jit
def split_words(text: bytes, start: int, end: int, words: Record) -> None:
    """Take ``text[start:end]`` apart: a line without comment and line end.

    The rules are those of Marlin's parser (``gcode/parser.cpp``, 2.1, built without subcodes,
    quoted strings and lower case): capitals only, the last of equal letters counts, a checksum is
    cut off, blanks may stand between a letter and its number, and whatever is neither letter nor
    number is skipped. A code is kept in 16 bits. Who must not be read so leniently asks
    `gcode.reading` first.

    Parameters
    ----------
    start, end : int
        The line.
    words : record of `WORDS`
        Written.
    """
    words.letter = 0
    words.number = -1
    words.numbered = -1
    words.seen = 0
    words.valued = 0
    at = _skip_blanks(text, start, end)
    if at + 1 < end and text[at] == _N and (is_digit(text[at + 1]) or text[at + 1] == _MINUS):
        value, _ = number_at(text, at + 1, end)
        words.numbered = int(value)
        at += 2
        while at < end and is_digit(text[at]):
            at += 1
        at = _skip_blanks(text, at, end)
    words.begin = at
    if at >= end:
        return
    letter = text[at]
    at += 1
    stop = at
    while stop < end and text[stop] != _STAR:
        stop += 1
    at = _skip_blanks(text, at, stop)
    if letter not in (_G, _M, _T) or at >= stop or not is_digit(text[at]):
        return
    words.letter = letter
    number = 0
    while at < stop and is_digit(text[at]):
        number = (number * 10 + (text[at] - _ZERO)) & _CODE_MASK
        at += 1
    words.number = number
    if letter == _M and number in _TEXT_CODES:
        return
    _split_parameters(text, at, stop, words)


@jit
def _split_parameters(text: bytes, at: int, stop: int, words: Record) -> None:
    while at < stop:
        letter = text[at]
        at += 1
        if _A <= letter <= _Z:
            at = _skip_blanks(text, at, stop)
            value, after = number_at(text, at, stop)
            bit = 1 << (letter - _A)
            words.seen |= bit
            words.valued &= ~bit
            if after > at:
                words.valued |= bit
                words.value[letter - _A] = value
                at = after
        while at < stop and (is_digit(text[at]) or text[at] in _REST):
            at += 1


MODAL: Final = np.dtype(
    [
        ("position", "f8", (4,)),  # native mm, x y z e
        ("shift", "f8", (3,)),  # workspace = native + shift (G92)
        ("plunger_shift", "f8"),  # plunger travel since power-up minus E, mm
        ("feed", "f8"),  # mm/s
        ("relative", "i8", (4,)),
        ("e_rule", "i8"),  # what makes E relative, an index of `E_RULES`
        ("m83", "i8"),  # 1 since M83, 0 since M82
        ("unit", "f8"),  # mm per unit of length
        ("speed_percent", "f8"),  # M220
        ("flow_percent", "f8"),  # M221
        ("low", "f8", (3,)),  # native mm, software endstops
        ("high", "f8", (3,)),
        ("limited", "i8", (3,)),  # 1 for an axis that was homed, while M211 is on
        ("heads", "i8"),  # how many there are
        ("tool", "i8"),  # the head that E moves
        ("left_at", "f8", (MOST_HEADS,)),  # plunger travel of each head as it was left, mm
    ],
    align=True,
)
"""State that outlives a line."""


OTHER, MOVE, ARC, DWELL, SYNC, SET_POSITION, HOME, BAD, TOOL = range(9)
"""Kinds of a command's effect: nothing that moves, waits or counts (known or not); a straight move
or an arc to the new position; a wait for the motors, then so many seconds; a wait for the motors
to stand (M400, a wait for heat or for the user); other numbers for the present position; a run to
the endstops; an arc that is none; another head, or the same again, once the motors stand."""

_I, _J, _R, _S, _P, _F, _E, _X = 8, 9, 17, 18, 15, 5, 4, 23
_SYNC_CODES = (0, 1, 109, 190, 400)


def new_modal(
    start_mm: tuple[float, float, float], heads: int = 1, e_rule: ERule = "with_axes"
) -> Records:
    """State after power-up with the tip at ``start_mm``, (1,) of `MODAL`.

    Absolute, millimetres, 25 mm/s (Marlin's first feed rate is 1500 mm/min), the first of
    ``heads``; E is relative as the firmware family has it (``e_rule``).
    """
    modal = np.zeros(1, MODAL)
    modal["e_rule"] = E_RULES.index(e_rule)
    modal["heads"] = heads
    modal["position"][0, :3] = start_mm
    modal["feed"] = 25.0
    modal["unit"] = 1.0
    modal["speed_percent"] = 100.0
    modal["flow_percent"] = 100.0
    return modal


@jit
def has_word(words: Record, letter: int) -> bool:
    """Whether a letter (0 = A) stands in the line with a number."""
    return (words.valued >> letter) & 1 == 1


@jit
def interpret(modal: Record, words: Record) -> int:
    """Carry a line's words into the modal state; returns the kind of its effect (`MOVE`, `ARC`, …).

    Parameters
    ----------
    modal : record of `MODAL`
        Changed: after a move, arc or homing `position` is where it will end.
    """
    number = words.number
    if words.letter == _G:
        if number <= 1:
            _set_target(modal, words)
            return MOVE
        if number <= 3:
            if not (has_word(words, _I) or has_word(words, _J) or has_word(words, _R)):
                _set_feed(modal, words)
                return BAD
            _set_target(modal, words)
            return ARC
        if number == 4:
            return DWELL
        if number == 20 or number == 21:
            modal.unit = 25.4 if number == 20 else 1.0
        elif number == 28:
            return HOME
        elif number == 90 or number == 91:
            for axis in range(3):
                modal.relative[axis] = 1 if number == 91 else 0
            if modal.e_rule == 0:
                modal.relative[3] = modal.relative[0]
            elif modal.e_rule == 2:
                modal.relative[3] = max(modal.relative[0], modal.m83)
        elif number == 92:
            _set_position(modal, words)
            return SET_POSITION
    elif words.letter == _M:
        if number == 82 or number == 83:
            modal.m83 = 1 if number == 83 else 0
            modal.relative[3] = modal.m83
            if modal.e_rule == 2:
                modal.relative[3] = max(modal.relative[0], modal.m83)
        elif number == 220 and has_word(words, _S):
            modal.speed_percent = words.value[_S]
        elif number == 221 and has_word(words, _S):
            modal.flow_percent = words.value[_S]
        elif number in _SYNC_CODES:
            return SYNC
    elif words.letter == _T and modal.heads > 1 and 0 <= number < modal.heads:
        _take_head(modal, number)
        return TOOL
    return OTHER


@jit
def _take_head(modal: Record, number: int) -> None:
    """E goes on counting where it is (Marlin's one counter), but moves another plunger."""
    modal.left_at[modal.tool] = modal.position[3] + modal.plunger_shift
    modal.plunger_shift = modal.left_at[number] - modal.position[3]
    modal.tool = number


@jit
def _set_target(modal: Record, words: Record) -> None:
    for axis in range(4):
        letter = _E if axis == 3 else _X + axis
        if has_word(words, letter):
            value = words.value[letter] * modal.unit
            if modal.relative[axis] != 0:
                modal.position[axis] += value
            else:
                modal.position[axis] = value - (modal.shift[axis] if axis < 3 else 0.0)
    for axis in range(3):
        if modal.limited[axis] != 0:
            within = max(modal.position[axis], modal.low[axis])
            modal.position[axis] = min(within, modal.high[axis])
    _set_feed(modal, words)


@jit
def _set_feed(modal: Record, words: Record) -> None:
    if has_word(words, _F) and words.value[_F] > 0:
        modal.feed = words.value[_F] * modal.unit / 60.0


@jit
def _set_position(modal: Record, words: Record) -> None:
    """G92: x, y and z shift the workspace, e is counted anew; alone it does nothing."""
    for axis in range(4):
        letter = _E if axis == 3 else _X + axis
        if has_word(words, letter):
            value = words.value[letter] * modal.unit
            if axis == 3:
                modal.plunger_shift += modal.position[3] - value
                modal.position[3] = value
            else:
                modal.shift[axis] = value - modal.position[axis]


@jit
def dwell_s(words: Record) -> float:
    """How long G4 waits: P milliseconds or S seconds, S wins."""
    seconds = 0.0
    if has_word(words, _P):
        seconds = words.value[_P] * 1e-3
    if has_word(words, _S):
        seconds = words.value[_S]
    return max(seconds, 0.0)


@jit
def speed(modal: Record) -> float:
    """Feed with the M220 factor, mm/s."""
    return modal.feed * 0.01 * modal.speed_percent


class ArcRules(NamedTuple):
    """How arcs are cut and which are refused, after Marlin."""

    longest_segment_mm: float = 1.0
    shortest_segment_mm: float = 0.1
    min_segments_per_turn: int = 72
    off_circle_mm: float = 0.1
    # No machine has room for it; Marlin counts its pieces, of 1 mm, in 16 bits.
    longest_arc_mm: float = 1e4
    least_turn: float = 1e-3


ARCS: Final = ArcRules()


@jit
def arc_centre(
    begin: NDArray[np.float64], end: NDArray[np.float64], words: Record, unit: float
) -> tuple[float, float]:
    """Centre of a G2/G3 arc in x and y, mm; NaN where there is none."""
    if has_word(words, _R):
        radius = words.value[_R] * unit
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        half = 0.5 * math.hypot(dx, dy)
        if half == 0.0 or radius == 0.0:
            return math.nan, math.nan
        side = -1.0 if (words.number == 2) != (radius < 0) else 1.0
        height = side * math.sqrt(max(radius * radius - half * half, 0.0))
        return (
            begin[0] + 0.5 * dx - height * dy / (2.0 * half),
            begin[1] + 0.5 * dy + height * dx / (2.0 * half),
        )
    i = words.value[_I] * unit if has_word(words, _I) else 0.0
    j = words.value[_J] * unit if has_word(words, _J) else 0.0
    if i == 0.0 and j == 0.0:
        return math.nan, math.nan
    return begin[0] + i, begin[1] + j


@jit
def arc_turn(
    begin: NDArray[np.float64], end: NDArray[np.float64], words: Record, cx: float, cy: float
) -> float:
    """Angle of an arc around its centre, rad, above 0 for G3; 0 where begin and end are abreast."""
    if begin[0] == end[0] and begin[1] == end[1]:
        return -2.0 * math.pi if words.number == 2 else 2.0 * math.pi
    rx, ry = begin[0] - cx, begin[1] - cy
    tx, ty = end[0] - cx, end[1] - cy
    turn = math.atan2(rx * ty - ry * tx, rx * tx + ry * ty)
    if words.number == 2 and turn > 0:
        turn -= 2.0 * math.pi
    elif words.number == 3 and turn < 0:
        turn += 2.0 * math.pi
    return turn


@jit
def arc_is_sound(
    begin: NDArray[np.float64], end: NDArray[np.float64], words: Record, unit: float
) -> bool:
    """Whether an arc has a centre, ends on its circle, and goes a way that no rounding turns round.

    A Marlin on an 8-bit board counts in 32 bits: an end abreast of the begin is left out, or made a
    whole turn.
    """
    cx, cy = arc_centre(begin, end, words, unit)
    if math.isnan(cx):
        return False
    if has_word(words, _R):
        chord = math.hypot(end[0] - begin[0], end[1] - begin[1])
        if chord > 2.0 * (abs(words.value[_R] * unit) + ARCS.off_circle_mm):
            return False
    elif abs(_radius(begin, cx, cy) - _radius(end, cx, cy)) > ARCS.off_circle_mm:
        return False
    turn = abs(arc_turn(begin, end, words, cx, cy))
    if _radius(begin, cx, cy) * turn > ARCS.longest_arc_mm:
        return False
    whole = begin[0] == end[0] and begin[1] == end[1]
    return whole or ARCS.least_turn < turn < 2.0 * math.pi - ARCS.least_turn


@jit
def _radius(at: NDArray[np.float64], cx: float, cy: float) -> float:
    return math.hypot(at[0] - cx, at[1] - cy)


@jit
def arc_points(
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    words: Record,
    unit: float,
    out: NDArray[np.float64],
) -> int:
    """Cut an arc (or helix) into straight segments.

    Parameters
    ----------
    begin, end : (4,) float64, mm
    words : record of `WORDS`
        Of the G2 (clockwise) or G3 line.
    unit : float
        mm per unit of I, J and R.
    out : (n, 4) float64, mm
        End of each segment, written as far as there is room.

    Returns
    -------
    int
        How many segments there are; 0 where the line describes no arc, -1 where it ends abreast
        of its begin, which Marlin leaves out.
    """
    cx, cy = arc_centre(begin, end, words, unit)
    if math.isnan(cx):
        return 0
    rx, ry = begin[0] - cx, begin[1] - cy
    radius = math.hypot(rx, ry)
    turn = arc_turn(begin, end, words, cx, cy)
    if turn == 0.0:
        return -1
    length = radius * abs(turn)
    least = math.ceil(ARCS.min_segments_per_turn * abs(turn) / (2.0 * math.pi))
    count = max(math.floor(length / ARCS.longest_segment_mm), least, 1)
    if length / count > ARCS.longest_segment_mm:
        count = math.ceil(length / ARCS.longest_segment_mm)
    elif length / count < ARCS.shortest_segment_mm:
        count = max(1, math.floor(length / ARCS.shortest_segment_mm))
    count = int(count)
    for k in range(min(count, len(out))):
        share = (k + 1) / count
        angle = turn * share
        cosine, sine = math.cos(angle), math.sin(angle)
        out[k, 0] = cx + rx * cosine - ry * sine
        out[k, 1] = cy + rx * sine + ry * cosine
        out[k, 2] = begin[2] + (end[2] - begin[2]) * share
        out[k, 3] = begin[3] + (end[3] - begin[3]) * share
    if count <= len(out):
        out[count - 1] = end
    return count
