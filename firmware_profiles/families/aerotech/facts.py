"""Aerotech's family record: known codes, dialect; runs program files, takes no streamed lines."""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.aerotech.dialect import dialect_of
from firmware_profiles.families.common_words import MOVE
from firmware_profiles.families.family import Family
from firmware_profiles.families.grammar import Grammar, Meaning, codes

_WORDS: Final = {
    "G0": MOVE,
    "G1": MOVE,
    "G4": "S",
    "G20": "",
    "G21": "",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
}

FAMILY: Final = Family(
    link=None,
    grammar=Grammar(
        codes=codes("G", 0, 1, 4, 20, 21, 90, 91, 92) | codes("M", 105, 400),
        names=dict.fromkeys(("$DO", "DIGITALOUTPUTSET"), Meaning.OTHER),
        words=_WORDS,
    ),
    dialect=dialect_of,
    file_controllers={"a3200": "$DO", "automation1": "DigitalOutputSet"},
)
"""Codes are those that its commands are translated into before they are read; names are the
commands that set an output."""
