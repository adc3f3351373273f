"""Handwritten small jobs with their networks, for the shaft checker."""

from dataclasses import dataclass, field

import numpy as np

from firmware_profiles import Printer, load
from gcode.clearance.check import Clearance, check_clearance
from gcode.clearance.kernels import NeedleBody
from gcode.clearance.motion import LineSources, NeedleMotion, motion_of
from gcode.clearance.network import WrittenNetwork
from gcode.dry_run.run import dry_run

NEEDLE = NeedleBody(0.155, clearance_mm=0.05)
RADIUS = 0.15
HIGH = 20.0
START = (100.0, 100.0, HIGH)


def network(*lines: object, radius: float = RADIUS) -> WrittenNetwork:
    """Vessels along polylines; ends at the same place are one node."""
    points = [np.array(line, dtype=float) for line in lines]
    ends = np.array([end for line in points for end in (line[0], line[-1])])
    nodes, which = np.unique(ends.round(6), axis=0, return_inverse=True)
    offset = np.concatenate([[0], np.cumsum([len(line) for line in points])])
    whole = np.concatenate(points)
    return WrittenNetwork(nodes, which.reshape(-1, 2), offset, whole, np.full(len(whole), radius))


@dataclass
class Job:
    """Lines of G-code, and of each the vessel and whether it writes; a plunger of 1 mm²."""

    text: list[str] = field(default_factory=lambda: ["G21", "; comment", "G90"])
    vessel: list[int] = field(default_factory=lambda: [-1] * 3)
    writes: list[bool] = field(default_factory=lambda: [False] * 3)
    at: np.ndarray = field(default_factory=lambda: np.array(START))
    pushed: float = 0.0

    def go(self, x: float, y: float, z: float, vessel: int = -1) -> int:
        """Travel straight; returns the line."""
        self.at = np.array([x, y, z], dtype=float)
        return self._say(f"G0 X{x:.4f} Y{y:.4f} Z{z:.4f} F1200", vessel, False)

    def over(self, x: float, y: float, z: float, vessel: int = -1) -> int:
        """Travel high above everything; returns the line of the descent."""
        self.go(self.at[0], self.at[1], HIGH, vessel)
        self.go(x, y, HIGH, vessel)
        return self.go(x, y, z, vessel)

    def write(self, x: float, y: float, z: float, vessel: int, radius: float = RADIUS) -> int:
        """Write straight; returns the line."""
        to = np.array([x, y, z], dtype=float)
        self.pushed += np.pi * radius**2 * float(np.linalg.norm(to - self.at))
        self.at = to
        return self._say(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} E{self.pushed:.6f} F300", vessel, True)

    def plunge(self, travel_mm: float, vessel: int) -> int:
        """Move the plunger alone; returns the line."""
        self.pushed += travel_mm
        return self._say(f"G1 E{self.pushed:.6f} F60", vessel, False)

    def along(self, points: object, vessel: int, radius: float = RADIUS) -> list[int]:
        """Go to a polyline's first point and write it; returns its lines."""
        first, *rest = np.array(points, dtype=float)
        self.over(*first, vessel)
        return [self.write(*point, vessel, radius) for point in rest]

    def _say(self, text: str, vessel: int, writes: bool) -> int:
        self.text.append(text)
        self.vessel.append(vessel)
        self.writes.append(writes)
        return len(self.text)

    def motion(self) -> NeedleMotion:
        data = ("\n".join(self.text) + "\n").encode()
        run = dry_run(data, load(Printer, "generic_marlin"), START)
        sources = LineSources(np.array(self.vessel), np.array(self.writes))
        return motion_of(run, sources, run.program.pushed * 1.0)

    def check(
        self, net: WrittenNetwork, needle: NeedleBody = NEEDLE, overlap: float = 0.5
    ) -> Clearance:
        return check_clearance(self.motion(), net, [needle], overlap)


def approach_of(found: Clearance, line: int) -> float:
    """Nearest approach of a line's move, mm."""
    return float(found.approach_mm[found.line == line].min())


def apart_of(found: Clearance, line: int) -> float:
    """The same to ink that isn't its own pass's and has no joint with it, mm."""
    return float(found.apart_mm[found.line == line].min())
