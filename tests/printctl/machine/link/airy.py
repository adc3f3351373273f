"""Test job for a pneumatic head, with an observer of its valve."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_profiles import Printer, load
from printctl.machine.job.job import Job
from tests.printctl.machine.link.fake_marlin import FakeMarlin
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script

AIR = load(Printer, "pneumatic_marlin")
HEAD = AIR.pneumatic
assert HEAD is not None
OPENS, CLOSES = HEAD.opens, HEAD.closes
START = (50.0, 50.0, 40.0)


def airy(layers: int, moves: int) -> bytes:
    """Zigzag layers of two paths each; the valve is shut for travels and at marks."""
    text = ["M85 S600", CLOSES, "G21", "G90", "M220 S100", "G92 X50 Y50 Z40"]
    for layer in range(layers):
        z = 10.0 + 0.25 * layer
        for path in range(2):
            text += [f"G0 X50 Y{51 + path} F6000", f"G0 Z{z:g} F240"]
            text += ["M400", OPENS, "G4 P30"]
            for k in range(moves):
                x, y = 50 + (k + layer + 1) % 2 * 3.5, 50 + path + k % 40 * 0.25
                text.append(f"G1 X{x:.3f} Y{y:.3f} F1800")
            text += ["M400", CLOSES, "G4 P30"]
        text += [f"G0 Z{z + 5:g} F240", f";LAYER_END:{layer}", ";RELOAD"]
    return ("\n".join([*text, "G0 Z40 F240", "M400"]) + "\n").encode()


@dataclass
class Airy(FakeMarlin):
    """A Marlin without extruder that keeps what its needle did with the valve open.

    Attributes
    ----------
    laid : list of (tuple of float, tuple of float)
        From where to where the tip went with the valve open, mm.
    opened : list of tuple of float, mm
        Where the tip stood when it was opened.
    """

    job: Job = field(default_factory=lambda: parse_job(airy(1, 1), "a"))
    script: Script = field(default_factory=Script)
    laid: list[tuple[tuple[float, ...], tuple[float, ...]]] = field(default_factory=list)
    opened: list[tuple[float, ...]] = field(default_factory=list)
    is_open: bool = False

    def __post_init__(self) -> None:
        super().__init__()
        self.at = {"X": 50.0, "Y": 50.0, "Z": 40.0}
        self.steps = "  M92 X80.00 Y80.00 Z400.00"
        self._next = 0

    @property
    def place(self) -> tuple[float, ...]:
        return tuple(self.at.values())

    def _do(self, command: str) -> bytes:
        before = self.place
        if command.split()[0] in ("M82", "M302", "M83") or " E" in command:
            self.executed.append(command)
            return f'echo:Unknown command: "{command}"\nok\n'.encode()
        said = super()._do(command)
        if command in (OPENS, CLOSES):
            self.is_open = command == OPENS
            if self.is_open:
                self.opened.append(self.place)
        elif self.is_open and self.place != before:
            self.laid.append((before, self.place))
        if self._next < len(self.job) and command == self.job.lines[self._next].decode():
            self._next += 1
            self.script.took(self._next)
        return said


def laid_by(job: Job) -> Airy:
    """What the job alone lays, without pauses."""
    printer = Airy(job=job)
    for line in job.lines:
        printer._do(line.decode())
    return printer
