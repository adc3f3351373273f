"""Motion controllers that load a program file themselves, and take no lines from a host."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from firmware_profiles.commands import is_output
from firmware_profiles.dispensers import Dispenser, Pneumatic


class Aerotech(BaseModel):
    """Which of Aerotech's controllers, and which of its axes pushes the ink."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    controller: Literal["a3200", "automation1"] = Field(
        description="a3200 (AeroBasic: $DO[0].X=1, WAIT MOVEDONE) or automation1 (AeroScript: "
        "DigitalOutputSet(X, 0, 1), WaitForMotionDone)."
    )
    plunger_axis: Annotated[str, Field(pattern=r"^[A-EU-W]$")] | None = Field(
        default=None, description="Letter of the axis that moves the plunger; none with a valve."
    )


def check_controller(
    firmware: str, aerotech: Aerotech | None, dispenser: Dispenser, sent: dict[str, tuple[str, ...]]
) -> None:
    """Refuse what doesn't fit together.

    Parameters
    ----------
    firmware : str
    aerotech : Aerotech or None
    dispenser : Dispenser
    sent : dict
        Commands that the host would send while it prints, by the profile's key.

    Raises
    ------
    ValueError
        Where the controller isn't said, or is for another family; where the plunger has no axis
        or a valve has one; for an output's command in another language; for commands that nobody
        would send.
    """
    head = dispenser if isinstance(dispenser, Pneumatic) else None
    valve = (head.opens, head.closes) if head else ()
    if firmware != "aerotech":
        if aerotech is not None:
            raise ValueError(f"aerotech: {firmware} isn't one; leave it out")
        for command in (*valve, *sent["safe_state_off"]):
            if is_output(command):
                raise ValueError(f"{command!r} is Aerotech's; {firmware} doesn't know it")
        return
    if aerotech is None:
        raise ValueError("firmware aerotech: say which controller (aerotech: {controller: a3200})")
    if (aerotech.plunger_axis is None) == (head is None):
        raise ValueError(
            "aerotech: plunger_axis is the letter of the plunger's axis; say it for a plunger, "
            "and leave it out for a pneumatic head"
        )
    begin = "$DO" if aerotech.controller == "a3200" else "DigitalOutputSet"
    for command in valve:
        if not command.startswith(begin):
            raise ValueError(
                f"dispenser: {aerotech.controller} switches an output by {begin}..., not by "
                f"{command!r}"
            )
    for key, commands in sent.items():
        if commands:
            raise ValueError(
                f"{key}: nothing is sent to an Aerotech controller, which runs the file by "
                "itself; leave it out, and have its own software do it"
            )
