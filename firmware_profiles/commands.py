"""Commands that a profile may name: they switch something, and move nothing."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import AfterValidator, Field

_MOVING: Final = ("MOVE", "HOME", "STEPPER", "RESTORE", "PROBE", "CALIBRATE")


def _moves_nothing(command: str) -> str:
    if any(word in command.partition(" ")[0].upper() for word in _MOVING):
        raise ValueError(f"{command!r} may move something; a safe state only switches")
    return command


SwitchCommand = Annotated[
    str,
    Field(pattern=r"^(M\d+|[A-Za-z]+_\w+)( [A-Za-z_]+=?[\w.\-]*)*$", max_length=64),
    AfterValidator(_moves_nothing),
]
"""An M command or a Klipper one with a name: no G, since nothing may move."""
