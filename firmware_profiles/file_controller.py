"""Profile section for controllers that run a program file; refuse settings that contradict it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Final

from pydantic import Field, TypeAdapter, ValidationError

from firmware_profiles.dispensers import Pneumatic
from firmware_profiles.families.registry import family_names, find_family
from firmware_profiles.heads import AxisLetter
from firmware_profiles.strict_model import (
    PRESSURE_UNITS,
    FileLine,
    StrictModel,
    SwitchCommand,
    addresses,
    check_values,
    is_output,
)

_COMMAND: Final = re.compile(
    r"(?<![\w$])(?:[GM]\d|(?:Drive)?Brake|Enable|Disable|Dwell|Linear|Rapid|Home|Move|Call)|\$.*=",
    re.IGNORECASE,
)
"""What begins a second command in a line; the A3200 takes several."""


class FileController(StrictModel):
    """Which controller of a family that loads files, and which of its axes pushes the ink."""

    controller: Annotated[str, Field(min_length=1, max_length=40)] = Field(
        description="One of those that the firmware's family has, such as a3200 (AeroBasic: "
        "$DO[0].X=1, WAIT MOVEDONE) or automation1 (AeroScript: DigitalOutputSet(X, 0, 1), "
        "WaitForMotionDone)."
    )
    plunger_axis: Annotated[str, Field(pattern=r"^[A-EU-W]$")] | None = Field(
        default=None, description="Letter of the axis that moves the plunger; none with a valve."
    )
    z_axis: AxisLetter = Field(
        default="Z", description="Letter of the vertical axis; of several heads see heads: z_axis."
    )
    begins: Annotated[tuple[FileLine, ...], Field(max_length=32)] = Field(
        default=(),
        description="The lab's own lines at the file's begin, e.g. [DVAR $AP, Enable X, ROUNDING "
        "ON]; none may move, or enable an axis whose brake is a valve (dispenser: enables).",
    )
    own_words: Annotated[
        tuple[Annotated[str, Field(pattern=r"^[A-Za-z]\w{0,39}$")], ...], Field(max_length=16)
    ] = Field(
        default=(),
        description="The lab's own functions that may begin such a line or sets_pressure; none may "
        "move.",
    )
    ends: Annotated[tuple[FileLine, ...], Field(max_length=128)] = Field(
        default=(),
        description="The same behind the last line, e.g. [Disable Aa, M2]; an own word may be "
        "defined there, from DFS to ENDDFS.",
    )

    @property
    def undefined_words(self) -> list[str]:
        """Own words that the file doesn't define: the controller must have them."""
        return [one for one in self.own_words if f"DFS {one}" not in self.ends]


def refuse_family_sections(keys: Mapping[str, object]) -> None:
    """Refuse a section that is called by a firmware's name.

    Raises
    ------
    ValueError
        With the key that takes its place.
    """
    names = family_names()
    for name, section in keys.items():
        if section is None or str(name).lower() not in names:
            continue
        if keys.get("file_controller") is not None:
            raise ValueError(
                f"{name} is no key here, and file_controller is there already: take {name} out, of "
                "starting_values too"
            )
        raise ValueError(
            f"{name} is no key here; the section is file_controller: write file_controller in "
            f"place of {name}, in starting_values too"
        )


def check_file_controller(
    firmware: str,
    given: FileController | None,
    airs: Sequence[Pneumatic],
    sent: Mapping[str, tuple[str, ...]],
) -> None:
    """Refuse what doesn't fit together.

    Parameters
    ----------
    firmware : str
    given : FileController or None
    airs : sequence of Pneumatic
        Every pneumatic head; none for a plunger.
    sent : mapping
        Commands that the host would send while it prints, by the profile's key.

    Raises
    ------
    ValueError
        Where the controller isn't said, or the family has none such; where the plunger has no axis
        or a valve has one; for an output's command in another language; for commands that nobody
        would send.
    """
    known = find_family(firmware).file_controllers
    valve = tuple(command for head in airs for command in (head.opens, head.closes))
    if not known:
        if any(head.enables for head in airs):
            raise ValueError(f"enables: {firmware} enables no axis by name; leave it out")
        _refuse_controller(firmware, given, (*valve, *sent["safe_state_off"]))
        for head in airs:
            _check_sent_pressure(head, airs)
        return
    if given is None:
        raise ValueError(
            f"firmware {firmware}: say which controller "
            f"(file_controller: {{controller: {next(iter(known))}}})"
        )
    if given.controller not in known:
        raise ValueError(
            f"file_controller.controller: {given.controller} isn't one of {', '.join(known)}"
        )
    if given.plunger_axis == given.z_axis:
        raise ValueError(
            f"file_controller: z_axis and plunger_axis are both {given.z_axis}; name two axes"
        )
    _check_head(given, known[given.controller], valve)
    executed = _outside_definitions(given)
    for key, lines in (("begins", given.begins), ("ends", executed)):
        check_values(f"file_controller.{key}", lines, ())
        _check_words(f"file_controller.{key}", lines, given, firmware)
    for head in airs:
        lines = head.sets_pressure + ((head.enables,) if head.enables else ())
        _check_words("sets_pressure, enables", lines, given, firmware)
        _check_enabled(head, (*given.begins, *executed))
        check_values("sets_pressure", head.sets_pressure, tuple(PRESSURE_UNITS))
    for key, commands in sent.items():
        if commands:
            raise ValueError(
                f"{key}: nothing is sent to a controller that runs the file by itself; leave it "
                "out, and have its own software do it"
            )


def _refuse_controller(
    firmware: str, given: FileController | None, commands: tuple[str, ...]
) -> None:
    if given is not None:
        raise ValueError(f"file_controller: {firmware} isn't one; leave it out")
    for command in commands:
        if is_output(command):
            raise ValueError(
                f"{command!r} sets an output of a controller that loads files; {firmware} doesn't "
                "know it"
            )


def _check_sent_pressure(head: Pneumatic, airs: Sequence[Pneumatic]) -> None:
    """Refuse what a host can't send as a head's pressure: but one command that switches."""
    if not head.sets_pressure:
        return
    if len(head.sets_pressure) > 1:
        raise ValueError(
            "sets_pressure: a host sends one line for a pressure, such as M42 P3 S{output}; "
            f"{len(head.sets_pressure)} are given"
        )
    line = re.sub(r"(?<![-.\d])\{\w+\}", "1", head.sets_pressure[0])
    try:
        TypeAdapter(SwitchCommand).validate_python(line)
    except ValidationError as exc:
        raise ValueError(
            f"sets_pressure: {head.sets_pressure[0]!r} isn't a command that only switches, such as "
            "M42 P3 S{output}"
        ) from exc
    if any(addresses(line, one.valve) for one in airs):
        raise ValueError(f"sets_pressure: {head.sets_pressure[0]!r} switches a valve (opens)")


def _check_words(key: str, lines: Sequence[str], given: FileController, firmware: str) -> None:
    """Refuse lines that begin with a word that isn't known to set up and never to move."""
    known = find_family(firmware).setup_words[given.controller]
    known |= {word.upper() for word in given.own_words}
    for line in lines:
        word = re.match(r"\$(?=\w+ ?=)|\w+", re.sub("^call +", "", line, flags=re.I))
        if word is None or word[0].upper() not in known:
            raise ValueError(
                f"{key}: {line!r} begins with no word that is known to move nothing "
                f"({', '.join(sorted(known))}); leave it out, or name the lab's own function in "
                "file_controller: own_words"
            )
        more = _COMMAND.search(line, line.index(word[0]) + len(word[0]))
        if more:
            raise ValueError(f"{key}: {line!r} holds a second command, {more[0]!r}; take it out")


def _outside_definitions(given: FileController) -> list[str]:
    """Return the lines of `ends` that run: all but an own word's body."""
    body = rf"^DFS ({'|'.join(given.own_words)})$.*?^ENDDFS(?:\n|\Z)"
    return re.sub(body, "", "\n".join(given.ends), flags=re.M | re.S).splitlines()


def _check_enabled(head: Pneumatic, lines: Sequence[str]) -> None:
    """Refuse lines that enable the axis whose brake is a valve."""
    brake = re.match(r"(?:Drive)?Brake\w*[ (]+(\w+)", head.opens, re.IGNORECASE)
    for line in lines:
        if brake and re.match(rf"Enable\b.*\b{brake[1]}\b", line, re.IGNORECASE):
            raise ValueError(
                f"file_controller: {line!r} may let the brake of {brake[1]} go, which is a valve; "
                "take it out, and say it as dispenser: enables, right before the valve opens"
            )


def _check_head(given: FileController, outputs: tuple[str, ...], valve: tuple[str, ...]) -> None:
    if (given.plunger_axis is None) != bool(valve):
        raise ValueError(
            "file_controller: plunger_axis is the letter of the plunger's axis; say it for a "
            "plunger, and leave it out for a pneumatic head"
        )
    for command in valve:
        if not command.startswith(outputs):
            ways = " or ".join(f"{output}..." for output in outputs)
            raise ValueError(
                f"dispenser: {given.controller} switches an output by {ways}, not by {command!r}"
            )
