"""Profile section for controllers that run a program file; refuse settings that contradict it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from firmware_profiles.dispensers import Dispenser, Pneumatic
from firmware_profiles.families.registry import family_names, find_family
from firmware_profiles.strict_model import StrictModel, is_output


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
    dispenser: Dispenser,
    sent: Mapping[str, tuple[str, ...]],
) -> None:
    """Refuse what doesn't fit together.

    Parameters
    ----------
    firmware : str
    given : FileController or None
    dispenser : Dispenser
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
    head = dispenser if isinstance(dispenser, Pneumatic) else None
    valve = (head.opens, head.closes) if head else ()
    if not known:
        _refuse_controller(firmware, given, (*valve, *sent["safe_state_off"]))
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
    _check_head(given, known[given.controller], valve)
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


def _check_head(given: FileController, output: str, valve: tuple[str, ...]) -> None:
    if (given.plunger_axis is None) != bool(valve):
        raise ValueError(
            "file_controller: plunger_axis is the letter of the plunger's axis; say it for a "
            "plunger, and leave it out for a pneumatic head"
        )
    for command in valve:
        if not command.startswith(output):
            raise ValueError(
                f"dispenser: {given.controller} switches an output by {output}..., not by "
                f"{command!r}"
            )
