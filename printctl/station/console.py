"""What is typed into the console of a standing printer, and which way it goes.

Moves and heaters' targets go the way of the wish for them, with its limits. What moves, heats or
counts in any other way is refused; the rest is sent as it is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from firmware_profiles import Printer
from printctl.link.by_hand import CODE, by_hand
from printctl.link.errors import Refused
from printctl.link.valve import is_about_valve

_WORD: Final = re.compile(r"([A-Z])([+-]?\d*\.?\d+)")
_HEATERS: Final = {"M104": "nozzle", "M140": "bed", "M141": "chamber"}
_KLIPPER_ASKS: Final = frozenset({"GET_POSITION", "STATUS", "HELP", "QUERY_ENDSTOPS", "QUERY_ADC"})
_OTHERWISE: Final = {
    "it moves without the soft limits; use jog, move_to or home": (
        {"G2", "G3", "G5", "G10", "G11", "G12", "G26", "G27", "G29", "G30", "G33", "G34", "G35"}
        | {"G38", "G42", "G60", "G61", "G76", "G80", "G425", "M125", "M48", "M600", "M603"}
        | {"M701", "M702", "M423", "M922", "G425", "M98", "M24", "M23", "M32", "M26"}
    ),
    "it waits for a temperature, and nothing else is heard meanwhile; use heat": (
        {"M109", "M190", "M191", "M116"}
    ),
    "it heats without a limit; use heat": {"M303", "M568", "M144"},
    "it changes what the checks rely on; close the station to configure the printer": (
        {"M206", "M208", "M218", "M428", "M500", "M501", "M502", "M92", "M211", "M564", "M82"}
        | {"G53", "G54", "G55", "G56", "G57", "G58", "G59", "G68", "G69", "M999", "M997", "M112"}
        | {"M17", "M0", "M1", "M108", "M350", "M569", "M584", "M574", "M203", "M201", "M220"}
    ),
}


@dataclass(frozen=True)
class Typed:
    """A line, understood.

    Attributes
    ----------
    wish : str
        ``move_to``, ``home``, ``heat``, or ``raw`` for one that is sent as it is.
    text : str
    values : mapping
        Of the wish.
    """

    wish: str
    text: str
    values: Mapping[str, Any]


def read_typed(typed: str, printer: Printer) -> Typed:
    """Understand a line.

    Raises
    ------
    Refused
    """
    try:
        text = by_hand(typed, printer)
    except ValueError as exc:
        raise Refused(
            f"{typed!r} can't be sent: one printable line of ASCII without * can"
        ) from exc
    code = CODE.match(text.upper())
    name = f"{code[1]}{code[2]}" if code else text.split(None, 1)[0].upper()
    words = {letter: float(value) for letter, value in _WORD.findall(text.upper()[len(name) :])}
    if name in ("G0", "G1"):
        return _move(text, words)
    if name == "G28":
        axes = [axis for axis in "xyz" if re.search(axis, text[3:], re.I)]
        return Typed("home", text, {"axes": axes or ["x", "y", "z"]})
    if name in _HEATERS:
        return _heater(name, text, words)
    _refuse_otherwise(name, text, printer)
    return Typed("raw", text, {})


def _move(text: str, words: Mapping[str, float]) -> Typed:
    if "E" in words:
        raise Refused(f"{text}: E moves the plunger without the syringe's limits; use plunger (µL)")
    speed = {"speed_mm_s": words["F"] / 60} if "F" in words else {}
    places = {axis: words[axis.upper()] for axis in "xyz" if axis.upper() in words}
    return Typed("move_to", text, {**places, **speed})


def _heater(name: str, text: str, words: Mapping[str, float]) -> Typed:
    if "S" not in words or "R" in words:
        raise Refused(f"{text}: say the target as S and a number of °C")
    head = f" {words['T']:.0f}" if words.get("T") else ""
    return Typed("heat", text, {"name": _HEATERS[name] + head, "celsius": words["S"]})


def _refuse_otherwise(name: str, text: str, printer: Printer) -> None:
    for why, names in _OTHERWISE.items():
        if name in names:
            raise Refused(f"{text} isn't sent from the console of a standing printer: {why}")
    if is_about_valve(text.upper().encode("ascii"), printer):
        raise Refused(f"{text} would open or shut the valve; it is switched by a print alone")
    asks = re.match(r"[GMT]\d", name) or name in _KLIPPER_ASKS
    if printer.firmware == "klipper" and not asks:
        raise Refused(f"{text}: Klipper's own commands and macros may move or heat; not sent")
