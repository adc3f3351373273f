"""Job of the product's writer for two pneumatic heads, and an observer of both on the wire."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from design.toolpath.gcode import GcodeOptions, HeadLoad, write_gcode
from design.toolpath.toolpath import MoveBuilder
from firmware_profiles import Printer, Syringe, load
from printctl.machine.job.job import Job
from tests.printctl.machine.link.fake_marlin import FakeMarlin
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script

RESTING, WRITING = 5, (30, 40)
"""In the output's own number: 255 at 510 kPa."""
START = (50.0, 50.0, 40.0)


def profile(**more: Any) -> Printer:
    """Two valves on outputs 0 and 1, their regulators on 2 and 3, two lifts on 4 and 5."""
    data = load(Printer, "pneumatic_marlin").model_dump() | {"safe_state_off": ()}
    air = data["dispenser"] | {"max_pressure_kpa": 510.0, "resting_kpa": 10.0}
    data["heads"] = [
        {
            "name": name,
            "offset_mm": {"x": 30.0 * k},
            "raised_mm": 25.0,
            "raises": f"M106 P{4 + k} S255",
            "lowers": f"M106 P{4 + k} S0",
            "moving_s": 0.05,
            "dispenser": air
            | {
                "pressure_kpa": 60.0 + 20.0 * k,
                "opens": f"M106 P{k} S255",
                "closes": f"M106 P{k} S0",
                "sets_pressure": [f"M106 P{2 + k} S{{output}}"],
            },
        }
        for k, name in enumerate(("left", "right"))
    ]
    data["dispenser"] = data["heads"][0]["dispenser"]
    return Printer.model_validate(data | more)


PAIR = profile()


def two_inks(passes: int, moves: int) -> bytes:
    """Zigzag passes by the heads in turn."""
    builder, tools = MoveBuilder(np.array([0.0, 0.0, 1.0]), "vessel"), []
    for number in range(passes):
        begin = np.array([1.0 * number, 0.0, 1.0])
        if number:
            up = [[*builder.tip[:2], 4.0], [*begin[:2], 4.0], begin]
            builder.travel(np.array(up), 20.0, number)
        along = np.arange(1, moves + 1)
        points = np.column_stack([begin[0] + along % 2 * 0.5, along * 0.5, np.full(moves, 1.0)])
        builder.write(points, np.full(moves, 0.05), 5.0, number)
        made = sum(len(run.end) for run in builder._runs)
        tools += [number % 2] * (made - len(tools))
    path = builder.build()
    path = type(path)(**{**vars(path), "tool": np.array(tools, dtype=np.int64)})
    syringe = load(Syringe, "hamilton_1ml")
    held = HeadLoad(syringe, flow_ul_s=0.2)
    options = GcodeOptions(start_mm=START, heads=(held, held))
    return write_gcode(path, PAIR, syringe, np.array([50.0, 50.0, 5.0]), options).data


DATA = two_inks(4, 5)
JOB = parse_job(DATA, "test.gcode", PAIR)


@dataclass
class Valves(FakeMarlin):
    """A Marlin without extruder that keeps what two needles did, and how the air stood.

    Attributes
    ----------
    output : dict of int to int
        What each output is set to; a valve that stood open and a pressure at first.
    laid : list of (int, tuple of float, tuple of float)
        Which head went from where to where with its valve open, mm.
    wrong : list of str
        Where a valve opened at another pressure, beside another, in motion or on a raised head, or
        a needle was lifted with its valve open.
    """

    job: Job = field(default_factory=lambda: JOB)
    script: Script = field(default_factory=Script)
    output: dict[int, int] = field(
        default_factory=lambda: {0: 255, 1: 255, 2: 99, 3: 99, 4: 0, 5: 0}
    )
    laid: list[tuple[int, tuple[float, ...], tuple[float, ...]]] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.at = dict(zip("XYZ", START, strict=True))
        self.steps = "  M92 X80.00 Y80.00 Z400.00"
        self._next, self._moves = 0, False

    @property
    def is_safe(self) -> bool:
        """Whether both valves are shut and both pressures at rest."""
        return [self.output[k] for k in range(4)] == [0, 0, RESTING, RESTING]

    def _do(self, command: str) -> bytes:
        before = tuple(self.at.values())
        self._moves = command != "M400" and (self._moves or command[:2] in ("G0", "G1"))
        said = super()._do(command)
        after, stood = tuple(self.at.values()), dict(self.output)
        if command.startswith("M106 P"):
            pin, value = (int(word[1:]) for word in command.split()[1:])
            self.output[pin] = value
        opened = [k for k in (0, 1) if self.output[k] and not stood[k]]
        for head in opened:
            air = [self.output[2 + head], self.output[3 - head]]
            lifts = [self.output[4 + head], self.output[5 - head]]
            if (
                self._moves
                or self.output[1 - head]
                or air != [WRITING[head], RESTING]
                or lifts != [0, 255]
            ):
                self.wrong.append(f"{command} with {self.output}")
        for head in (0, 1):
            if self.output[head] and before != after:
                self.laid.append((head, before, after))
                if before[2] != after[2]:
                    self.wrong.append(f"{command} with valve {head} open")
        if self._next < len(self.job) and command == self.job.lines[self._next].decode():
            self._next += 1
            self.script.took(self._next)
        return said


def alone(job: Job) -> Valves:
    """What a job does by itself, without a link; its valves shut and air at rest before."""
    printer = Valves(job=job, output={0: 0, 1: 0, 2: RESTING, 3: RESTING, 4: 0, 5: 255})
    for line in job.lines:
        printer._do(line.decode())
    return printer
