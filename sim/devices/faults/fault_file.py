"""Read planned faults of a simulated printer and its cable from a YAML file or short text.

A fault file is YAML::

    seed: 7
    noise: 0.0004            # chance of each byte that one of its bits flips
    noise_on: both           # or down (to the printer), up (from it)
    drop_ok: 0.001           # chance of each ok
    delay: 0.001             # chance of each reply that it comes delay_s late
    delay_s: 0.3
    ok_delays_s: [0, 0, 5]   # each ok in turn comes so late, and what is said behind it with it
    ok_delay_up_to_s: 5      # or: each ok by itself, anything up to this
    drop_byte: 0.0001        # chance of each byte that it is lost
    speed: 0.5               # the whole board runs at this share of its time
    latency_s: 0.016         # every reply comes so late, as through a USB adapter
    at:                      # moments: by line number, printer's clock or bytes received
      - {fault: noise, line: 100, rate: 0.05, length_bytes: 400}
      - {fault: unplug, line: 2000, back_after_s: 2}
      - {fault: endstop_stuck, time_s: 0, axis: x, stuck: open}
      - {fault: runaway, bytes: 50000}
      - {fault: late_oks, line: 200, seconds: 5}
      - {fault: stall, line: 300, seconds: 4}
      - {fault: slow, line: 400, share: 0.5}
    gauges:                  # what it tells of a sensor: straight between times, by its clock
      - {command: M871, says: "Force: {value:.2f} N", ramp: [[0, 1.0], [60, 15.0]]}
    ink:                     # what becomes of the ink; the motors know nothing of it
      - {fault: clog, written_mm: 120, clears_ul: 0.5}   # all kinds: sim.gcode.deposit.ink_faults
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from sim.devices.faults.gauge import Gauge
from sim.errors import ServeError
from sim.gcode.deposit.ink_faults import InkFault, InkFaults
from sim.model_file import read_model

FaultKind = Literal[
    "unplug",
    "reset",
    "kill",
    "drop_ok",
    "runaway",
    "noise",
    "delay",
    "late_oks",
    "stall",
    "slow",
    "endstop_stuck",
]
Direction = Literal["both", "down", "up"]
Chance = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=86_400)]
Share = Annotated[float, Field(ge=0.01, le=1)]

_OWN: Final[dict[str, tuple[str, ...]]] = {
    "unplug": ("back_after_s",),
    "noise": ("rate", "length_bytes"),
    "delay": ("seconds",),
    "late_oks": ("seconds",),
    "stall": ("seconds",),
    "slow": ("share",),
    "endstop_stuck": ("axis", "stuck"),
}
"""Keys that only one fault has; all but ``back_after_s`` must be given."""


class Fault(BaseModel):
    """Something that goes wrong at a moment.

    Attributes
    ----------
    fault : FaultKind
        ``unplug``: the cable is pulled, and plugged in again where `back_after_s` says when.
        ``reset``: the board starts anew. ``kill``: the firmware stops itself (a thermal runaway
        out of the blue). ``drop_ok``: the ok to the line is lost. ``runaway``: the hotend's heater
        loses its power while the firmware believes it is on. ``noise``: `rate` of the next
        `length_bytes` on the cable are garbled. ``delay``: the next reply is `seconds` late.
        ``late_oks``: from now on each ok comes up to `seconds` late, by chance.
        ``stall``: board, motors and wire stand still for `seconds`, and go on. ``slow``: from now
        on the whole board runs at `share` of its time. ``endstop_stuck``: `axis`' switch stays
        ``open`` (never found) or ``closed`` (found at once, wherever the carriage stands).
    line, time_s, bytes
        The moment: when the firmware takes the line of this N word, when its clock shows this,
        or when it has received so many bytes. One of them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    fault: FaultKind
    line: Annotated[int, Field(ge=0)] | None = None
    time_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    bytes: Annotated[int, Field(ge=0)] | None = None
    back_after_s: Seconds | None = None
    rate: Chance | None = None
    length_bytes: Annotated[int, Field(ge=1)] | None = None
    seconds: Seconds | None = None
    share: Share | None = None
    axis: Literal["x", "y", "z"] | None = None
    stuck: Literal["open", "closed"] | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> Fault:
        if sum(v is not None for v in (self.line, self.time_s, self.bytes)) != 1:
            raise ValueError("give one of line, time_s and bytes as the moment")
        if self.fault == "drop_ok" and self.line is None:
            raise ValueError("drop_ok is the ok to a line: give line")
        mine = _OWN.get(self.fault, ())
        for kind, keys in _OWN.items():
            for key in keys:
                given = getattr(self, key) is not None
                if given and key not in mine:
                    raise ValueError(f"{key} belongs to {kind}, not to {self.fault}")
                if not given and kind == self.fault and key != "back_after_s":
                    raise ValueError(f"{kind} needs {key}")
        return self


class PermanentFaults(BaseModel):
    """What is wrong with cable and board all the time, most of it as a chance; see the module."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    noise: Chance = 0.0
    noise_on: Direction = "both"
    drop_ok: Chance = 0.0
    delay: Chance = 0.0
    delay_s: Seconds = 0.3
    ok_delays_s: tuple[Seconds, ...] = ()
    ok_delay_up_to_s: Seconds = 0.0
    drop_byte: Chance = 0.0
    speed: Share = 1.0
    latency_s: Seconds = 0.0


class FaultFile(PermanentFaults):
    """A fault file; see the module."""

    seed: Annotated[int, Field(ge=0)] = 0
    at: tuple[Fault, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    ink: tuple[InkFault, ...] = ()

    @property
    def of_ink(self) -> InkFaults:
        """Faults of the ink, with the file's seed."""
        return InkFaults(self.ink, self.seed)


_FAULT: Final = re.compile(r"([a-z_]+)@(\d+)")


def parse_fault(text: str) -> Fault:
    """Read ``unplug@120``: a fault without further keys, at a line.

    Raises
    ------
    ServeError
        When it isn't one.
    """
    match = _FAULT.fullmatch(text)
    kinds = [kind for kind in get_args(FaultKind) if kind not in _OWN or kind == "unplug"]
    if match is None or match[1] not in kinds:
        raise ServeError(
            f"fault {text!r} isn't one of {', '.join(f'{kind}@LINE' for kind in kinds)}; "
            "others go into a fault file"
        )
    return Fault.model_validate({"fault": match[1], "line": int(match[2])})


def load_faults(path: Path) -> FaultFile:
    """Read a fault file.

    Raises
    ------
    ServeError
        When it can't be read, or has a key or value that means nothing.
    """
    return read_model(path, FaultFile, "fault file", ServeError)
