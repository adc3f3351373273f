"""Verdict of the G-code gate on a line: allowed with its text, or refused with the reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

Place = tuple[float, float, float]
NOT_BY_HAND: Final = "isn't for manual use"


class LineAction(StrEnum):
    """What carries an allowed line out."""

    SEND = "send"
    """It is sent as it is."""
    MOVE = "move"
    """A straight move of the tip to `Allowed.target`, at `Allowed.speed_mm_s`."""
    HOME = "home"
    """Homing of `Allowed.axes`."""
    HEAT = "heat"
    """A target for the heater `Allowed.heater`."""


@dataclass(frozen=True)
class AllowedLine:
    """Verdict on an allowed line.

    Attributes
    ----------
    text : str
        What is sent: rendered from what was understood.
    act : LineAction
    target : (x, y, z) or None, mm
        Of a move.
    speed_mm_s : float or None, mm/s
        Of a move, where the line says it.
    axes : tuple of str
        To home.
    heater : str
        ``nozzle``, ``nozzle 1``, ``bed``, ``chamber``, where the line sets a target; else empty.
    celsius : float, °C
    undo : tuple of str
        Settings (codes) that must be as before once the job has ended.
    """

    text: str
    act: LineAction = LineAction.SEND
    target: Place | None = None
    speed_mm_s: float | None = None
    axes: tuple[str, ...] = ()
    heater: str = ""
    celsius: float = 0.0
    undo: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class Refusal:
    """A line that may not leave.

    Attributes
    ----------
    message : str
        What, the value, its limit, where that comes from, and the remedy.
    """

    message: str


Verdict = AllowedLine | Refusal


class NotAllowed(Exception):  # noqa: N818 (an answer, which `printctl.checks.gate.judge` gives back)
    """Something that no line may do; the message is a refusal's."""
