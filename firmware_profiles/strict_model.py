"""Pydantic bases of recipe sections and profiles, bounded number types, pattern of commands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    model_validator,
)
from pydantic_core import CoreSchema

_STRICT: Final = frozenset({"bool", "float", "int", "str"})


def _make_strict(schema: Any) -> None:
    """Let no text or truth value pass for a number in a schema and all that it holds."""
    if isinstance(schema, dict):
        if schema.get("type") in _STRICT:
            schema.setdefault("strict", True)
        for part in schema.values():
            _make_strict(part)
    elif isinstance(schema, list | tuple):
        for part in schema:
            _make_strict(part)


BeadShape = Literal["rounded", "rectangle", "ellipse"]
MeasuredExcess = Annotated[float, Field(ge=0, le=500, allow_inf_nan=False)]
"""Measured width over area / height, µm."""


class StrictModel(BaseModel):
    """Base of recipe sections and profiles.

    Text and true aren't numbers, 1 isn't true; a whole number passes for any number. Lists still
    pass for tuples, which pydantic's own strict mode refuses.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The model's schema, with every plain value strict."""
        schema = handler(source)
        _make_strict(schema)
        return schema


# A profile holds facts with their source, not a user's taste.
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Celsius = Annotated[float, Field(ge=-80, le=300)]
Trigger = Literal["neutral_ph", "calcium", "thrombin"]
"""What makes an ink set in the bath while it is printed."""
CommandName = Annotated[str, Field(pattern=r"^([GMT]\d+|[A-Za-z]+_\w+)$")]


class Facts(StrictModel):
    """Base of all profiles: unknown keys are refused, values can't be changed."""

    name: str = Field(min_length=1, description="Name shown to the user.")
    source: str = Field(min_length=1, description="Where the numbers come from.")
    licence: str = Field(min_length=1, description="Licence of the numbers.")
    starting_values: tuple[str, ...] = Field(
        default=(),
        description="Keys whose numbers have no source: measure them, or compare with the "
        "machine's own, before the first print.",
    )

    @model_validator(mode="after")
    def _starting_values_are_keys(self) -> Facts:
        for name in self.starting_values:
            key, _, part = name.partition(".")
            value = getattr(self, key, None) if key in type(self).model_fields else None
            inside = isinstance(value, BaseModel) and part in type(value).model_fields
            if key not in type(self).model_fields or (part and not inside):
                raise ValueError(
                    f"starting_values names {name!r}, which is no key of this sort of profile"
                )
        return self


class Span(StrictModel):
    """Lowest and highest value."""

    low: Annotated[float, Field(allow_inf_nan=False)]
    high: Annotated[float, Field(allow_inf_nan=False)]

    @model_validator(mode="after")
    def _ordered(self) -> Span:
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} isn't below high {self.high:g}")
        return self


STOPS: Final = frozenset({"M0", "M1", "M108", "M110", "M112", "M410", "M999"})
_MOVING: Final = ("MOVE", "HOME", "STEPPER", "RESTORE", "PROBE", "CALIBRATE")
_OUTPUT: Final = (
    r"\$DO(?:\[\d+\]\.[A-Z]|\d+\.\d+) ?= ?[01]|DigitalOutputSet\([A-Z], ?\d+, ?[01]\)"
    r"|BRAKE [A-Za-z]\w* [01]|DriveBrakeO(?:n|ff)\([A-Za-z]\w*\)"
)
_VALUE_OF: Final = re.compile(r"(?<==).*|[-.\d]+$")
_ADDRESSES: Final = ("PIN=", "SERVO=", "FAN=", "STEPPER=", "EXTRUDER=", "NAME=")
_BRAKE_CALL: Final = re.compile(r"DriveBrakeO(n|ff)\((\w+)\)")


def is_output(command: str) -> bool:
    """Whether a command sets a digital output or an axis' brake in an Aerotech's language."""
    return re.fullmatch(_OUTPUT, command) is not None


def switch_words(command: str) -> list[str]:
    """A command's name and words; of an output or a brake what it is, and its value."""
    brake = _BRAKE_CALL.fullmatch(command)
    if brake:
        return [f"DriveBrake({brake[2]})", "1" if brake[1] == "n" else "0"]
    if is_output(command):
        return [re.sub(r"[ ,=]*[01]\)?$", "", command).replace(" ", ""), command.rstrip(")")[-1]]
    return command.split()


def switched(one: str, other: str) -> frozenset[str]:
    """What two commands both set, a pin, a fan or a brake, in one writing: M042 p00 is M42 P0.

    Raises
    ------
    ValueError
        Where they aren't one command with two values of one word.
    """
    first, second = _words(one), _words(other)
    keys = [[_VALUE_OF.sub("", word) for word in words[1:]] for words in (first, second)]
    differs = [key for key, a, b in zip(keys[0], first[1:], second[1:], strict=False) if a != b]
    same = first[0] == second[0] and keys[0] == keys[1] and len(differs) == 1
    if not same or len(set(keys[0])) < len(keys[0]):
        raise ValueError(
            f"{one!r} and {other!r} must be one command with two values (M42 P4 S255 and M42 P4 S0)"
        )
    if differs[0] != "S" if re.match(r"M\d", first[0]) else differs[0] in _ADDRESSES:
        raise ValueError(
            f"{one!r} and {other!r} differ in {differs[0]}, which says what is set; only its value "
            "may differ (S of an M command)"
        )
    return frozenset(first) & frozenset(second)


def addresses(command: str, output: frozenset[str]) -> bool:
    """Whether a command sets what `switched` gives; M107 does as M106 does."""
    return output <= frozenset(_words(re.sub(r"^[Mm]0*107\b", "M106", command)))


def _words(command: str) -> list[str]:
    """A command's words in one writing and order; the fan that M106 leaves out is P0."""
    name, *rest = [
        re.sub(r"^([A-Z])0+(?=\d)", r"\1", word.upper()) for word in switch_words(command)
    ]
    if name in ("M106", "M107") and not any(word[0] == "P" for word in rest):
        rest.append("P0")
    return [name, *sorted(rest)]


def _moves_nothing(command: str) -> str:
    if any(word in command.partition(" ")[0].upper() for word in _MOVING):
        raise ValueError(f"{command!r} may move something; a safe state only switches")
    if _words(command)[0] in STOPS:
        raise ValueError(f"{command!r} stops or renumbers; name a command that only switches")
    return command


SwitchCommand = Annotated[
    str,
    Field(
        pattern=rf"^((M\d+|[A-Za-z]+_\w+)( [A-Za-z_]+=?[\w.\-]*)*|{_OUTPUT})$",
        max_length=64,
    ),
    AfterValidator(_moves_nothing),
]
"""An M command, a Klipper one with a name, an Aerotech's output or brake: nothing may move."""


PRESSURE_UNITS: Final = {"kpa": 1.0, "psi": 6.894757, "bar": 100.0}
"""Name of a value in a line to kPa in one of its unit."""
_VALUE: Final = re.compile(r"\{(\w*)\}")
_GLUED: Final = re.compile(r"[^A-Za-z=(, ]\{|\}[^), ]")


def _plain_line(line: str) -> str:
    if ";" in line or "//" in line or "'" in line:
        raise ValueError(f"{line!r} holds a comment (; // '); write the command alone")
    return line


FileLine = Annotated[
    str,
    Field(pattern=r"^[A-Za-z$][ -~]*[^ \n]$", max_length=120),
    AfterValidator(_plain_line),
]
"""One line of a program file, as the controller reads it."""


def check_values(key: str, lines: Sequence[str], values: Sequence[str]) -> None:
    """Refuse lines whose braces hold anything but these values.

    Raises
    ------
    ValueError
        With the line.
    """
    for line in lines:
        rest = _VALUE.sub("", line)
        unknown = set(_VALUE.findall(line)) - set(values)
        if unknown or "{" in rest or "}" in rest:
            known = ", ".join(f"{{{one}}}" for one in values) or "none"
            raise ValueError(f"{key}: {line!r} holds another value than it may have ({known})")
        if values and (_GLUED.search(line) or re.search(r"[-+*/^%]", line)):
            raise ValueError(
                f"{key}: {line!r} makes another number of its value; write the value alone, "
                "without digits beside it or arithmetic"
            )


def round_output(value: float, full: float) -> float:
    """Round what {output} says: whole numbers up to 255, four digits up to 1."""
    return round(value * full, 0 if full > 1 else 4)


def fill_pressure(lines: Sequence[str], kpa: float, share: float, full: float) -> list[str]:
    """Return lines with a pressure in the place of {kpa}, {psi}, {bar} or {output}.

    ``share`` is the pressure's of the regulator's greatest, ``full`` the output's number for that.
    """
    values = {unit: f"{kpa / factor:.6g}" for unit, factor in PRESSURE_UNITS.items()}
    return [line.format(**values, output=f"{round_output(share, full):g}") for line in lines]
