"""Pattern of profile commands that switch an output; refuse G codes and anything that may move."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import AfterValidator, Field

_MOVING: Final = ("MOVE", "HOME", "STEPPER", "RESTORE", "PROBE", "CALIBRATE")


_OUTPUT: Final = r"\$DO(?:\[\d+\]\.[A-Z]|\d+\.\d+) ?= ?[01]|DigitalOutputSet\([A-Z], ?\d+, ?[01]\)"


def is_output(command: str) -> bool:
    """Whether a command sets a digital output in one of Aerotech's languages."""
    return re.fullmatch(_OUTPUT, command) is not None


def switch_words(command: str) -> list[str]:
    """A command's name and words; of an output what it is, and its value."""
    if is_output(command):
        return [re.sub(r"[ ,=]*[01]\)?$", "", command).replace(" ", ""), command.rstrip(")")[-1]]
    return command.split()


def _moves_nothing(command: str) -> str:
    if any(word in command.partition(" ")[0].upper() for word in _MOVING):
        raise ValueError(f"{command!r} may move something; a safe state only switches")
    return command


SwitchCommand = Annotated[
    str,
    Field(
        pattern=rf"^((M\d+|[A-Za-z]+_\w+)( [A-Za-z_]+=?[\w.\-]*)*|{_OUTPUT})$",
        max_length=64,
    ),
    AfterValidator(_moves_nothing),
]
"""An M command, a Klipper one with a name or an Aerotech's output: no G, nothing may move."""
