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
    r"(?<![\w$])(?:[GM]\d|(?:Drive)?Brake|Enable|Disable|Dwell|Linear|Rapid|Home|Move(?!done)|Call|Freerun"
    r"|CC?W\b|Abort|Program|Digital|Analog)|\$.*=",
    re.IGNORECASE,
)
"""What begins a second command in a line (the A3200 takes several), and no function of a lab's."""

_ANALOG: Final = frozenset({"$AO", "ANALOGOUTPUTSET"})
"""Set an analogue output, as for a regulator."""
_PROGRAM_END: Final = "M2"
"""Ends a program of an A3200; functions stand behind it."""


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
    axes: Sequence[str],
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
    axes : sequence of str
        Vertical axes.

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
    setup = find_family(firmware).setup_words[given.controller]
    executed = _outside_definitions(given, setup)
    for key, lines in (("begins", given.begins), ("ends", executed)):
        check_values(f"file_controller.{key}", lines, ())
        _check_words(f"file_controller.{key}", lines, given, setup)
    every = [line for head in airs for line in head.sets_pressure]
    for head in airs:
        lines = head.sets_pressure + ((head.enables,) if head.enables else ())
        _check_words("sets_pressure, enables", lines, given, setup | _ANALOG)
        _check_enabled(head, (*given.begins, *executed, *every), (*"XY", *axes))
        check_values("sets_pressure", head.sets_pressure, tuple(PRESSURE_UNITS))
        _check_variables(head.sets_pressure)
        _check_pressure_words(head.sets_pressure, given, (*given.begins, *executed))
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


def _check_words(
    key: str, lines: Sequence[str], given: FileController, setup: frozenset[str]
) -> None:
    """Refuse lines that begin with a word that isn't known to set up and never to move."""
    for word in given.own_words:
        if word.upper() in setup or _COMMAND.match(word):
            raise ValueError(
                f"file_controller.own_words: {word!r} is or begins as a word of the controller's, "
                "and may move; take it out, or give the lab's own function another name"
            )
    known = setup | {word.upper() for word in given.own_words}
    for line in lines:
        called = re.sub("^call +", "", line, flags=re.I)
        first = re.match(r"\$(?=\w+ ?=)|\$AO(?=\[\d+\]\.\w ?=)|\w+", called)
        if first is None or first[0].upper() not in known:
            raise ValueError(
                f"{key}: {line!r} begins with no word that is known to move nothing "
                f"({', '.join(sorted(known))}); leave it out, or name the lab's own function in "
                "file_controller: own_words"
            )
        if first[0].upper() == _PROGRAM_END and key != "file_controller.ends":
            raise ValueError(f"{key}: {line!r} ends the program; write it in ends alone")
        more = _COMMAND.search(line, line.index(first[0]) + len(first[0]))
        if more:
            raise ValueError(f"{key}: {line!r} holds a second command, {more[0]!r}; take it out")


def _outside_definitions(given: FileController, setup: frozenset[str]) -> list[str]:
    """Return the lines of `ends` that run: all but an own word's body, behind the program's end."""
    lines = [*given.ends]
    until = lines.index(_PROGRAM_END) + 1 if _PROGRAM_END in lines else len(lines)
    body = rf"^DFS ({'|'.join(given.own_words)})$.*?^ENDDFS(?:\n|\Z)"
    behind = re.sub(body, "", "\n".join(lines[until:]), flags=re.M | re.S).splitlines()
    for line in (*lines[:until], *behind):
        if line.upper().startswith("DFS") and _PROGRAM_END in setup:
            raise ValueError(
                f"file_controller.ends: the program would run into {line!r}; write "
                f"{_PROGRAM_END} before it and ENDDFS behind it, and name it in own_words"
            )
    return [*lines[:until], *behind]


def _check_enabled(head: Pneumatic, lines: Sequence[str], axes: Sequence[str]) -> None:
    """Refuse lines that may enable the axis whose brake is a valve, and `enables` of another."""
    brake = re.match(r"(?:Drive)?Brake\w*[ (]+(\w+)", head.opens, re.IGNORECASE)
    if brake and brake[1].upper() in axes:
        raise ValueError(
            f"opens: {head.opens!r} lets go the brake of an axis that moves; name the valve's own"
        )
    if head.enables and not (
        brake and re.fullmatch(rf"Enable[ (]+{brake[1]}\)?", head.enables, re.IGNORECASE)
    ):
        raise ValueError(
            f"enables: {head.enables!r} enables more or else than the axis whose brake is the "
            f"valve ({head.opens}); name that alone, or leave it out for a valve on an output"
        )
    for line in lines:
        enabled = re.match(r"Enable\b(.*)", line, re.IGNORECASE) if brake else None
        names = [] if enabled is None else re.findall(r"[^][(), ]+", enabled[1].upper())
        if not {*names} <= {*axes}:
            raise ValueError(
                f"{line!r} may let the brake go that is a valve ({head.opens}); name moving axes "
                f"alone ({', '.join(axes)}), and the valve's as dispenser: enables"
            )


def _check_variables(lines: Sequence[str]) -> None:
    """Refuse a variable that is used before a line sets it: it may be another head's still."""
    given: set[str] = set()
    for line in lines:
        sets = re.match(r"(?:D?VAR +)?(\$\w+)[^=]*=(.*)", line, re.IGNORECASE)
        for name in re.findall(r"\$\w+", sets[2] if sets else line):
            if name not in given:
                raise ValueError(
                    f"sets_pressure: {line!r} takes {name}, which no line before it sets, so that "
                    f"another head's may count; put {name}=... before it"
                )
        given |= {sets[1]} if sets else set()


def _check_pressure_words(
    pressure: Sequence[str], given: FileController, lines: Sequence[str]
) -> None:
    """Refuse an own word of `sets_pressure` in other lines, which would set a pressure too."""
    for word in given.own_words:
        called = re.compile(rf"\b{word}\b", re.IGNORECASE)
        other = next(filter(called.search, lines), None)
        if other is not None and any(map(called.search, pressure)):
            raise ValueError(
                f"file_controller: {other!r} would set a pressure that nobody checks; take it out "
                "and leave that to dispenser: sets_pressure"
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
