"""Parse each firmware family's replies to settings queries into a printer's settings.

Only questions: none of these commands sets anything. Answers are read as

- Marlin, Prusa: M115, M503 (M92, M201, M203, M204, M205 in it), M211;
- RepRapFirmware: M115, M92, M201, M203 (mm/min), M208, M302, as ``GCodes2.cpp`` (3.5) words them;
- by a family's own phrases (`Family.setting_phrases`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from firmware_profiles.families import Family
from printctl.machine.job.firmware import parse_firmware

_SETTING: Final = re.compile(r"\b(M\d+(?:\.\d+)?)((?: [A-Z]-?\d+(?:\.\d+)?)+)")
_PAIR: Final = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")
_LISTED: Final = re.compile(r"\b([XYZE]): ?(-?\d+(?:\.\d+)?)")
_SPAN: Final = re.compile(r"\b([XYZ]) ?(-?\d+(?:\.\d+)?):(-?\d+(?:\.\d+)?)")
_ENDS: Final = re.compile(r"Min: (.*?)Max: (.*)")
_LISTS: Final = (
    ("Steps/mm:", "steps_per_mm", 1.0),
    ("Accelerations (mm/sec^2):", "max_acceleration_mm_s2", 1.0),
    ("Max speeds (mm/min):", "max_speed_mm_s", 1 / 60),
    ("Max speeds (mm/sec):", "max_speed_mm_s", 1.0),
)


@dataclass(frozen=True)
class Settings:
    """What a printer says of itself.

    Attributes
    ----------
    firmware : str
        Its name for itself.
    values : dict of str to float or bool
        By the profile's key: ``steps_per_mm.x``, ``x_mm.low``, ``emergency_parser``.
    notes : tuple of str
        What it says that no profile has a key for.
    """

    firmware: str
    values: dict[str, float | bool] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_settings(family: Family, answers: dict[bytes, Sequence[bytes]]) -> Settings:
    """Read the answers to a family's questions (`Family.setting_questions`)."""
    firmware = parse_firmware(answers.get(b"M115", ()))
    values: dict[str, float | bool] = {}
    notes: list[str] = []
    for name, key in (("EMERGENCY_PARSER", "emergency_parser"), ("ADVANCED_OK", "advanced_ok")):
        if name in firmware.capabilities:
            values[key] = firmware.capabilities[name]
    for replies in answers.values():
        for reply in replies:
            text = reply.decode("ascii", "replace")
            values.update(_read(family, text))
            notes += _noted(text)
    return Settings(firmware.name, values, tuple(notes))


def _read(family: Family, text: str) -> Iterator[tuple[str, float | bool]]:
    for words, key in family.setting_phrases.items():
        match = re.search(rf"{re.escape(words)}:? (\d+(?:\.\d+)?)", text)
        if match:
            yield key, float(match[1])
    if family.setting_phrases:
        return
    for begin, key, factor in _LISTS:
        if text.startswith(begin):
            for axis, value in _LISTED.findall(text.partition(", min.")[0]):
                yield f"{key}.{axis.lower()}", float(value) * factor
    if text.startswith("Axis limits"):
        for axis, low, high in _SPAN.findall(text.partition(")s ")[2] or text):
            yield f"{axis.lower()}_mm.low", float(low)
            yield f"{axis.lower()}_mm.high", float(high)
    ends = _ENDS.search(text)
    if ends:
        for end, words in (("low", ends[1]), ("high", ends[2])):
            for axis, value in _PAIR.findall(words):
                yield f"{axis.lower()}_mm.{end}", float(value)
    for code, words in _SETTING.findall(text):
        yield from _setting(code, dict(_PAIR.findall(words)))


def _setting(code: str, words: dict[str, str]) -> Iterator[tuple[str, float | bool]]:
    """A command that would set what is set, as M503 lists them."""
    keys = {"M92": "steps_per_mm", "M201": "max_acceleration_mm_s2", "M203": "max_speed_mm_s"}
    if code in keys:
        for axis in words.keys() & set("XYZE"):
            yield f"{keys[code]}.{axis.lower()}", float(words[axis])
    if code == "M204" and words.keys() & set("PS"):
        yield "acceleration_mm_s2", float(words.get("P") or words["S"])
    if code == "M205" and "J" in words:
        yield "junction_deviation_mm", float(words["J"])
    if code == "M205" and "B" in words:
        yield "min_segment_time_s", float(words["B"]) * 1e-6


def _noted(text: str) -> Iterator[str]:
    if text.startswith(("Cold extrusion is", "echo:Cold extrudes are")):
        yield text.removeprefix("echo:")
    if "M211 S0" in text:
        yield "its software endstops are off (M211 S0): only the host's own checks hold it back"
    if "pressure_advance:" in text and float(text.split(":")[-1]) != 0:
        yield f"{text.removeprefix('// ')}: it changes the plunger's flow by itself"
