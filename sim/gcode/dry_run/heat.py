"""Collect every temperature that a file sets or waits for, by whatever command.

Beside M104, M109 (tool) and M140, M190 (bed) there are ways round them: M303, which heats while it
tunes; RepRapFirmware's G10 and M568 for a tool, and M141, M191 for a chamber, which warms ink and
bath alike; commands with names (`Meaning.HEATS`), and those that wait for a
temperature (`Meaning.AWAITS`): for ever, where what is mounted doesn't bear it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from firmware_profiles.families import meanings
from firmware_profiles.families.grammar import Meaning
from sim.gcode.program.gcode import Command, Program, code, parse_line
from sim.gcode.reading.line import NamedCommand

Part = Literal["ink", "bath", "both"]
Bound = Literal["is", "least", "most"]
_KEYS: Final[dict[Meaning, dict[str, Bound]]] = {
    Meaning.HEATS: {"TARGET": "is"},
    Meaning.AWAITS: {"MINIMUM": "least", "MAXIMUM": "most"},
}
_TOOL, _BED, _CHAMBER = ("M104", "M109", "G10", "M568"), ("M140", "M190"), ("M141", "M191")
_CODES: Final = tuple(code(name) for name in (*_TOOL, *_BED, *_CHAMBER, "M303"))


@dataclass(frozen=True)
class Heating:
    """Temperature set by one line.

    Attributes
    ----------
    line : int
        Of the file, from 1.
    part : "ink", "bath" or "both"
        What it warms or cools; a Klipper heater of one's own naming counts as both.
    celsius : float, °C
        0 switches off.
    bound : "is", "least" or "most"
        Whether it is set, or waited for from below or from above.
    """

    line: int
    part: Part
    celsius: float
    bound: Bound = "is"


def heatings(
    program: Program, gcode: bytes, named: tuple[NamedCommand, ...]
) -> tuple[Heating, ...]:
    """All settings of a file, in its order.

    Parameters
    ----------
    program : Program
    gcode : bytes
        What it was read from.
    named : tuple of NamedCommand
        Commands with names.
    """
    rows = np.flatnonzero(np.isin(program.code, _CODES))
    lines = gcode.splitlines() if len(rows) else []
    settings = [
        Heating(number, *fields)
        for number in program.line[rows].tolist()
        for fields in _said(parse_line(lines[number - 1]))
    ]
    settings += [one for at in named for one in _named(at)]
    return tuple(sorted(settings, key=lambda heating: heating.line))


def _said(command: Command) -> list[tuple[Part, float]]:
    """What a line sets, if it does: a G10 without S or R, say, is an offset."""
    part: Part = "ink" if command.name in _TOOL else "bath" if command.name in _BED else "both"
    if command.name == "M303":
        part = "bath" if command.values.get("E", 0.0) < 0 else "ink"
    letters = "SR"
    if command.name == "G10" and "L" in command.values:
        letters = ""
    return [(part, command.values[word]) for word in letters if word in command.values]


def _named(at: NamedCommand) -> list[Heating]:
    heater = at.words.get("HEATER") or at.words.get("SENSOR", "")
    part: Part = "both"
    if heater.startswith("extruder"):
        part = "ink"
    elif heater == "heater_bed":
        part = "bath"
    keys = _KEYS.get(meanings().get(at.name, Meaning.OTHER), {})
    if "TARGET" in keys:
        targets = [(at.words.get("TARGET", "0"), keys["TARGET"])]
    else:
        targets = [(at.words[key], bound) for key, bound in keys.items() if key in at.words]
    return [
        Heating(at.line, part, number, bound) for text, bound in targets for number in _read(text)
    ]


def _read(text: str) -> list[float]:
    """The number, or none where it isn't one: the gate refuses the line."""
    try:
        return [float(text)]
    except ValueError:
        return []
