"""Questions that make a printer's profile, at most twelve, and the YAML that their answers give."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import ValidationError

from firmware_profiles import Printer, Syringe, load, profile_doubts, shipped
from firmware_profiles.cross_checks import AVR_STEPS_HZ
from firmware_profiles.errors import refuse
from firmware_profiles.families import Family, family_names, family_of, find_family
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import UsageError

PLUNGER, AIR = "plunger", "air"
BOTH_COOLINGS, NO_COOLING = "both", "none"
_LINK_KEYS: Final = ("planner_blocks", "command_queue", "receive_buffer_bytes")
"""What no user knows of a board: taken from a shipped profile of the same firmware."""
_PLAIN: Final = "generic_marlin"
_UNUSED_E: Final = {"steps": 500, "speed": 25, "acceleration": 1000}
"""Of an extruder that a pneumatic head doesn't use."""

Answers = Mapping[str, Any]


@dataclass(frozen=True)
class Question:
    """One question about a printer.

    Attributes
    ----------
    key : str
        Its name in a file of answers.
    text : str
    hint : str
        Where the answer is found, one line.
    default : callable
        The answer that Enter gives, as text, from the answers so far.
    read : callable
        Makes the value of a text; ValueError says what is wrong.
    fills : tuple of str
        Keys of the profile that are starting values where only the default stands.
    head : str
        `PLUNGER` or `AIR` where only that head is asked for it.
    """

    key: str
    text: str
    hint: str
    default: Callable[[Answers], str]
    read: Callable[[str], Any]
    fills: tuple[str, ...] = ()
    head: str = ""


@dataclass
class Sheet:
    """Answers so far, in order, with the keys of those that were given and not left to a default.

    Attributes
    ----------
    source : str
        For the profile: who answered, and when.
    """

    source: str
    answers: dict[str, Any] = field(default_factory=dict)
    given: set[str] = field(default_factory=set)

    def questions(self) -> Iterator[Question]:
        """Yield the questions that this printer is asked, each once the last is answered."""
        for question in QUESTIONS:
            if not question.head or question.head == self.answers["head"]:
                yield question

    def take(self, question: Question, text: str) -> None:
        """Take an answer, empty for the default.

        Raises
        ------
        UsageError
            With what is wrong; the sheet is as it was.
        """
        before = (dict(self.answers), set(self.given))
        try:
            value = question.read(text or question.default(self.answers))
            self.answers[question.key] = value
            if text:
                self.given.add(question.key)
            self.profile_text()
        except ValueError as exc:
            self.answers, self.given = before
            raise UsageError(f"{question.key}: {exc}") from exc

    def profile_text(self) -> str:
        """Return the profile, with defaults for what is still open.

        Raises
        ------
        ValueError
            Where it is no profile, or one that mustn't be used.
        """
        full = Sheet(self.source, dict(self.answers), set(self.given))
        for question in full.questions():
            if question.key not in full.answers:
                full.answers[question.key] = question.read(question.default(full.answers))
        text = yaml.safe_dump(
            _profile(full), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None
        )
        try:
            printer = Printer.model_validate(read_yaml(text))
        except ValidationError as exc:
            raise ValueError(refuse(exc, Printer, "the profile")) from exc
        grave = [f"{doubt.key}: {doubt.text}" for doubt in profile_doubts(printer) if doubt.grave]
        if grave:
            raise ValueError("; ".join(grave))
        return text

    def notes(self) -> list[str]:
        """Return what is to be known of the finished profile, in the syringe that was named."""
        printer = Printer.model_validate(read_yaml(self.profile_text()))
        syringe = self.answers.get("syringe")
        syringes = [load(Syringe, syringe)] if syringe else []
        return [f"{doubt.key}: {doubt.text}" for doubt in profile_doubts(printer, syringes)]


def read_answers(file: Path) -> dict[str, str]:
    """Read a file of answers: a question's key with its answer, as it would be typed.

    Raises
    ------
    UsageError
        Where it can't be read, or names no question.
    """
    try:
        data = read_yaml(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as exc:
        raise UsageError(f"--answers {file}: {exc}") from exc
    known = [question.key for question in QUESTIONS]
    if not isinstance(data, dict) or not set(data) <= set(known):
        wrong = ", ".join(map(str, set(data) - set(known))) if isinstance(data, dict) else "no keys"
        raise UsageError(f"--answers {file}: {wrong}; it has `key: answer` of {', '.join(known)}")
    return {
        key: " ".join(map(str, value)) if isinstance(value, list) else str(value)
        for key, value in data.items()
    }


def _profile(sheet: Sheet) -> dict[str, Any]:
    """Return the profile's keys; all answers are there."""
    said, template = sheet.answers, _template(sheet.answers["firmware"])
    air = said["head"] == AIR
    e = dict(_UNUSED_E)
    if not air:
        e |= {"steps": said["plunger_steps"], "speed": said["plunger_speed"]}
    most = said["acceleration"]
    xyz_e = {
        "steps_per_mm": [*said["steps"], e["steps"]],
        "max_speed_mm_s": [*said["speed"], e["speed"]],
        "max_acceleration_mm_s2": [most, most, min(most, 100), e["acceleration"]],
    }
    facts = template.model_dump(mode="json", include=template.model_fields_set)
    data: dict[str, Any] = {
        "name": said["name"],
        "source": sheet.source,
        "licence": "facts, no licence needed",
        "firmware": said["firmware"],
        **{
            f"{axis}_mm": {"low": 0, "high": high}
            for axis, high in zip("xyz", said["travel"], strict=True)
        },
        **{key: dict(zip("xyze", values, strict=True)) for key, values in xyz_e.items()},
        "acceleration_mm_s2": most,
        **{key: facts[key] for key in _LINK_KEYS if key in facts},
        "resets_on_connect": template.resets_on_connect,
        "idle_timeout_s": template.idle_timeout_s,
    }
    if air:
        data["dispenser"] = {
            "kind": "pneumatic",
            "pressure_kpa": said["pressure"],
            "max_pressure_kpa": said["max_pressure"],
            "opens": said["opens"],
            "closes": said["closes"],
            "opening_delay_s": 0.03,
            "closing_delay_s": 0.03,
        }
    else:
        data["plunger_travel_mm"] = said["plunger_travel"]
    data["safe_state_on"] = _COOLINGS[said["stays_on"]]
    data["starting_values"] = _starting(sheet, data)
    return data


def _starting(sheet: Sheet, data: Mapping[str, Any]) -> list[str]:
    """Return the keys that nobody answered for; all of a table's axes as the table."""
    missing = {"baud", "max_acceleration_mm_s2", *(key for key in _LINK_KEYS if key in data)}
    for question in sheet.questions():
        if question.key not in sheet.given:
            missing.update(question.fills)
    if "dispenser" in data:
        missing |= {"dispenser.opening_delay_s", "dispenser.closing_delay_s"}
        missing |= {"steps_per_mm.e", "max_speed_mm_s.e"}
    for table in ("steps_per_mm", "max_speed_mm_s"):
        axes = {f"{table}.{axis}" for axis in "xyze"}
        if axes <= missing:
            missing = (missing - axes) | {table}
    return sorted(missing)


def _plain_family() -> Family:
    return family_of(load(Printer, _PLAIN))


@cache
def _template(name: str) -> Printer:
    """Return a shipped profile of a firmware, with one plunger if there is one."""
    every = [load(Printer, one) for one in (_PLAIN, *shipped(Printer))]
    kin = [one for one in every if family_of(one) is find_family(name)]
    return next((one for one in kin if one.pneumatic is None and not one.heads), every[0])


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} isn't a number") from None
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{text} must be above 0")
    return int(value) if value.is_integer() else value


def _three(text: str) -> list[float]:
    words = text.replace(",", " ").split()
    if len(words) != 3:
        raise ValueError(f"{text!r} isn't three numbers, of X, Y and Z with a space between")
    return [_number(word) for word in words]


def _one_of(*choices: str) -> Callable[[str], str]:
    def read(text: str) -> str:
        if text.lower() not in choices:
            raise ValueError(f"{text!r} is none of {', '.join(choices)}")
        return text.lower()

    return read


def _always(text: str) -> Callable[[Answers], str]:
    return lambda _: text


def _speed_for(steps: float, most: float) -> str:
    """Return a speed that an 8-bit board's step rate allows, mm/s."""
    return f"{min(most, math.floor(100 * AVR_STEPS_HZ / steps) / 100):g}"


def _other_value(opens: str) -> str:
    """Return the command with the other value of its output: S0, or S255 where that opens it."""
    stem, _, value = opens.rpartition("S")
    return f"{stem}S{255 if value == '0' else 0}"


def _axes(key: str) -> tuple[str, ...]:
    return tuple(f"{key}.{axis}" for axis in "xyz")


_STREAMED: Final = tuple(name for name in family_names() if find_family(name).make_protocol)
_COOLINGS: Final = {
    BOTH_COOLINGS: ["bath cooling", "ink cooling"],
    "ink": ["ink cooling"],
    "bath": ["bath cooling"],
    NO_COOLING: [],
}
_SPEEDS: Final = (100.0, 100.0, 5.0)

QUESTIONS: Final = (
    Question(
        "name", "What is the machine called?", "As people in the lab call it.",
        _always("Our printer"), str,
    ),
    Question(
        "firmware", f"Which firmware has it ({', '.join(_STREAMED)})?",
        "Its display shows it under Info or About; a Duet board has RepRapFirmware.",
        lambda _: next(one for one in _STREAMED if find_family(one) is _plain_family()),
        _one_of(*_STREAMED), ("firmware",),
    ),
    Question(
        "travel", "How far do X, Y and Z go (mm)?",
        "From the home corner to the far end, with the head that is mounted.",
        _always("200 200 200"), _three, ("x_mm", "y_mm", "z_mm"),
    ),
    Question(
        "steps", "How many steps per mm have X, Y and Z?",
        "M92 in its configuration, or Motion > Steps/mm on its display; Enter to ask the machine.",
        _always("80 80 400"), _three, _axes("steps_per_mm"),
    ),
    Question(
        "speed", "How fast may X, Y and Z go (mm/s)?",
        "M203 in its configuration, or Motion > Velocity on its display; Enter to ask the machine.",
        lambda said: " ".join(map(_speed_for, said["steps"], _SPEEDS)),
        _three, _axes("max_speed_mm_s"),
    ),
    Question(
        "acceleration", "With which acceleration does it print (mm/s²)?",
        "M204 in its configuration; slow is safe for ink.",
        _always("500"), _number, ("acceleration_mm_s2",),
    ),
    Question(
        "head", f"What pushes the ink ({PLUNGER} or {AIR})?",
        f"{PLUNGER}: a motor with a screw on the syringe; {AIR}: a hose and a valve on it.",
        _always(PLUNGER), _one_of(PLUNGER, AIR),
    ),
    Question(
        "syringe", "Which syringe is in the head?",
        "A name of `printctl profiles`, printed on the barrel as maker and volume.",
        _always("hamilton_1ml"), _one_of(*shipped(Syringe)), head=PLUNGER,
    ),
    Question(
        "plunger_steps", "How many steps move the plunger by 1 mm?",
        "Motor steps x microsteps x gear / mm of the screw in a turn: 200 x 16 / 0.5 = 6400.",
        _always("6400"), _number, ("steps_per_mm.e",), PLUNGER,
    ),
    Question(
        "plunger_speed", "How fast may the plunger go (mm/s)?",
        "As fast as the motor turns without losing steps, on an empty syringe.",
        lambda said: _speed_for(said["plunger_steps"], 2.0),
        _number, ("max_speed_mm_s.e",), PLUNGER,
    ),
    Question(
        "plunger_travel", "How far can the plunger go (mm)?", "From the upper to the lower stop.",
        _always("60"), _number, ("plunger_travel_mm",), PLUNGER,
    ),
    Question(
        "pressure", "To which pressure is the regulator set (kPa)?",
        "Its gauge, above ambient; 1 bar is 100 kPa, 1 psi 6.9 kPa.",
        _always("80"), _number, ("dispenser.pressure_kpa",), AIR,
    ),
    Question(
        "max_pressure", "What is the most that it can give (kPa)?", "The end of its gauge's scale.",
        lambda said: f"{max(700, said['pressure']):g}",
        _number, ("dispenser.max_pressure_kpa",), AIR,
    ),
    Question(
        "opens", "Which command opens the valve?",
        "That of the output to which it is wired: M106 P0 S255 for fan 0, or M42 P4 S255.",
        _always("M106 P0 S255"), str, ("dispenser.opens",), AIR,
    ),
    Question(
        "closes", "Which command closes it?", "The same output with another value.",
        lambda said: _other_value(said["opens"]), str, ("dispenser.closes",), AIR,
    ),
    Question(
        "stays_on", f"What must go on cooling after a stop ({', '.join(_COOLINGS)})?",
        "Cells and collagen in the syringe, gelatin in the dish; every heater goes off.",
        _always(BOTH_COOLINGS), _one_of(*_COOLINGS), ("safe_state_on",),
    ),
)  # fmt: skip
