"""The board that the simulated firmware runs on, and the faults it can be told to have."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal, get_args

from sim.errors import ServeError

FaultKind = Literal["unplug", "reset", "kill", "drop_ok"]


@dataclass(frozen=True)
class Board:
    """How fast an ATmega2560 at 16 MHz is, from the recorded transcripts.

    Attributes
    ----------
    command_s : float
        For one command while the motors stand.
    step_s : float
        Of the stepper's interrupt, for one step event; it takes this from the main thread.
    most_load : float
        Largest share of the processor that the interrupt gets.
    thermistors : bool
        Whether the temperature inputs are wired; without, a heater ends in a MINTEMP stop.
    """

    command_s: float = 0.002
    step_s: float = 40e-6
    most_load: float = 0.8
    thermistors: bool = True


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong when the firmware takes line ``line`` (its N word)."""

    kind: FaultKind
    line: int


_FAULT: Final = re.compile(r"([a-z_]+)@(\d+)")


def parse_fault(text: str) -> Fault:
    """Read ``unplug@120``.

    Raises
    ------
    ServeError
        When it isn't a known fault at a line number.
    """
    match = _FAULT.fullmatch(text)
    kinds = get_args(FaultKind)
    if match is None or match[1] not in kinds:
        raise ServeError(
            f"fault {text!r} isn't one of {', '.join(f'{kind}@LINE' for kind in kinds)}"
        )
    kind: FaultKind = match[1]  # type: ignore[assignment]
    return Fault(kind, int(match[2]))
