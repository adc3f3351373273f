"""Parse position replies: M114 in every firmware family's format, Klipper's GET_POSITION."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

_POSITION: Final = re.compile(rb"([XYZE]): ?(-?\d+\.\d+)")
_PLACE: Final = re.compile(rb"(?:ok )?X: ?-?\d")
"""How M114's place begins."""
_COMMANDED: Final = b"gcode: "
_SHIFT: Final = b"gcode base: "
_MOTOR: Final = re.compile(rb"stepper_([xyz]):(-?\d+(?:\.\d+)?)")
_COUNT: Final = re.compile(
    rb" Count X: ?(-?[\d.]+) Y: ?(-?[\d.]+) Z: ?(-?[\d.]+)(?: E: ?-?[\d.]+)?$"
)

_MACHINE: Final = re.compile(
    rb" Count((?: -?\d+){3,}) Machine((?: -?[\d.]+){3,})(?: Bed comp (-?[\d.]+))?"
)


def parse_position(replies: Sequence[bytes]) -> dict[str, float]:
    """Read the reply to M114, mm, by axis letter; empty when it isn't there."""
    for text in replies:
        if _PLACE.match(text) and b" Z:" in text:
            words = text.split(b"Count")[0]
            return {axis.decode(): float(value) for axis, value in _POSITION.findall(words)}
    return {}


def parse_counts(replies: Sequence[bytes], per_mm: Mapping[str, float]) -> dict[str, float]:
    """Read where the motors' steps are from the reply to M114, mm; empty where it tells none.

    Marlin tells steps, of which there are ``per_mm``; Prusa-Firmware tells mm, with decimals.
    """
    match = next((match for text in replies if (match := _COUNT.search(text))), None)
    if match is None:
        return {}
    told = dict(zip("XYZ", match.groups(), strict=True))
    in_mm = tells_counts_in_mm(replies)
    return {axis: float(value) / (1.0 if in_mm else per_mm[axis]) for axis, value in told.items()}


def tells_counts_in_mm(replies: Sequence[bytes]) -> bool:
    """Whether the reply to M114 tells motors' places in mm, rounded, not in whole steps."""
    match = next((match for text in replies if (match := _COUNT.search(text))), None)
    return match is not None and any(b"." in value for value in match.groups())


def parse_shifted(replies: Sequence[bytes]) -> tuple[dict[str, float], dict[str, float]]:
    """Read Klipper's reply to GET_POSITION (``gcode_move.py``), mm, by axis letter.

    Returns
    -------
    place : dict
        Of the last command, as the job counts it; of E what was pushed (M221 counts).
    shift : dict
        What G92 and SET_GCODE_OFFSET add to places of the job. Both are empty where one is missing.
    """
    at, shift = _words_behind(_COMMANDED, replies), _words_behind(_SHIFT, replies)
    if not set("XYZE") <= set(at) & set(shift):
        return {}, {}
    return {axis: at[axis] - shift[axis] for axis in "XYZE"}, shift


def parse_motors(replies: Sequence[bytes]) -> dict[str, tuple[float, float]]:
    """Read motors from Klipper's reply to GET_POSITION: steps, and the place they stand for, mm.

    Both are of the same moment, though not of the present one: steps made ahead count.
    """
    steps, places = _motors(b"mcu: ", replies), _motors(b"stepper: ", replies)
    return {axis: (steps[axis], places[axis]) for axis in sorted(set(steps) & set(places))}


def parse_driven(replies: Sequence[bytes]) -> dict[str, tuple[float, float]]:
    """Read from Klipper's reply to GET_POSITION where the motors' steps lead, and should, mm.

    ``kinematic`` is reckoned from them for any kind of axes, ``toolhead`` holds a levelling; where
    they aren't told each motor counts as its axis.
    """
    made = _words_behind(b"kinematic: ", replies) or _motors(b"stepper: ", replies)
    meant = _words_behind(b"toolhead: ", replies) or _words_behind(_COMMANDED, replies)
    return {axis: (made[axis], meant[axis]) for axis in "XYZ" if axis in made and axis in meant}


def parse_machine(
    replies: Sequence[bytes], per_mm: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Read from RepRapFirmware's reply to M114 where motors are, and should be, mm.

    ``Count`` are the motors' steps now, ``Machine`` the place in the machine's own coordinates that
    the last command leads to; the bed's compensation is added to Z. Where each axis has its motor.
    """
    match = next((match for text in replies if (match := _MACHINE.search(text))), None)
    if match is None:
        return {}
    meant = dict(zip("XYZ", map(float, match[2].split()), strict=False))
    meant["Z"] += float(match[3] or 0.0)
    steps = zip("XYZ", match[1].split(), strict=False)
    return {axis: (int(count) / per_mm[axis], meant[axis]) for axis, count in steps}


def _motors(start: bytes, replies: Sequence[bytes]) -> dict[str, float]:
    text = next((text for text in map(_bare, replies) if text.startswith(start)), b"")
    return {axis.decode().upper(): float(value) for axis, value in _MOTOR.findall(text)}


def _bare(text: bytes) -> bytes:
    return text.removeprefix(b"// ")


def _words_behind(start: bytes, replies: Sequence[bytes]) -> dict[str, float]:
    text = next((text for text in map(_bare, replies) if text.startswith(start)), b"")
    return {axis.decode(): float(value) for axis, value in _POSITION.findall(text)}
