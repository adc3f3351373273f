"""Data classes of a calibration pattern; its inked frame and toolpath."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from design.toolpath import MoveBuilder, Toolpath
from firmware_profiles import Ink
from firmware_profiles.materials.bead import BeadSection
from firmware_profiles.strict_model import BeadShape
from kernels.arrays import FloatArray

PatternName = Literal["lines", "spiral", "joint", "bridge", "comb", "squares"]
Role = Literal[
    "frame", "line", "step", "spiral", "trunk", "branch", "tooth", "pillar", "bridge", "side"
]
MARGIN_MM: Final = 3.0
"""Between the frame and all else."""


@dataclass(frozen=True)
class Bead:
    """Commanded width and height of a line.

    Attributes
    ----------
    width_mm : float, mm
        Diameter of a filament, or width of a line on a plate.
    layer_mm : float, mm
        Height of a line on a plate; the rise from layer to layer of a filament's pillar.
    round_bead : bool
        Whether it is a filament in a bath.
    section : str or float
        Of a line on a plate: the ink's `BeadSection.model`. Files of before say none: straight.
    """

    width_mm: float
    layer_mm: float
    round_bead: bool
    section: BeadShape | float = "rectangle"

    @property
    def flat(self) -> BeadSection:
        """Cross-section of a line on a plate."""
        return BeadSection(self.section)

    @property
    def area_mm2(self) -> float:
        """Cross-section at a flow of 1."""
        if self.round_bead:
            return math.pi / 4 * self.width_mm**2
        return float(self.flat.area(self.width_mm, self.layer_mm))

    def width_at(self, flow: float) -> float:
        """Width that a multiple of the cross-section gives, mm."""
        if self.round_bead:
            return self.width_mm * math.sqrt(flow)
        return float(self.flat.width(np.array(flow * self.area_mm2), self.layer_mm))

    def share(self, width_mm: FloatArray) -> FloatArray:
        """Cross-section that a width tells, over the commanded one at a flow of 1."""
        width = np.asarray(width_mm, dtype=np.float64)
        if self.round_bead:
            return (width / self.width_mm) ** 2
        return self.flat.area(width, self.layer_mm) / self.area_mm2


@dataclass(frozen=True)
class Stroke:
    """One unbroken written path.

    Attributes
    ----------
    number : int
        As on the sheet; 0 for the frame and what isn't measured.
    role : Role
    points : (k, 3) float64, mm
    speed_mm_s : (k - 1,) float64, mm/s
    flow : float
        Multiple of the bead's cross-section.
    """

    number: int
    role: Role
    points: FloatArray
    speed_mm_s: FloatArray
    flow: float = 1.0

    @property
    def length_mm(self) -> float:
        """Of the path."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True)
class Question:
    """Something asked of the print that isn't a width: a gap, a joint, a bridge.

    Attributes
    ----------
    number : int
    value : float
        What was varied: gap or span in mm, overlap in radii.
    lines : (m, 2, 2) float64, mm
        Straight ways, each from the middle of one ink to the middle of the next, along which a
        picture is asked; empty where no picture can tell.
    """

    number: int
    value: float
    lines: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))


@dataclass(frozen=True)
class Pattern:
    """A calibration print.

    Attributes
    ----------
    name : PatternName
    bead : Bead
    size_mm : (x, y), mm
        Of the frame.
    strokes : tuple of Stroke
        In the order of writing, the frame's first.
    questions : tuple of Question
    """

    name: PatternName
    bead: Bead
    size_mm: tuple[float, float]
    strokes: tuple[Stroke, ...]
    questions: tuple[Question, ...] = ()

    def of_role(self, *roles: Role) -> list[Stroke]:
        """Strokes of some roles, in order."""
        return [stroke for stroke in self.strokes if stroke.role in roles]

    @property
    def top_mm(self) -> float:
        """Highest point written."""
        return max(float(stroke.points[:, 2].max()) for stroke in self.strokes)


def frame(size_mm: tuple[float, float], speed_mm_s: float) -> list[Stroke]:
    """The fiducial: two sides whole, and the halves of the others that meet."""
    x, y = size_mm
    whole = [(0, y), (0, 0), (x, 0)]
    halves = [(x, y / 2), (x, y), (x / 2, y)]
    return [straight(0, "frame", corners, speed_mm_s) for corners in (whole, halves)]


def straight(
    number: int,
    role: Role,
    corners: list[tuple[float, float]],
    speed_mm_s: float | FloatArray,
    flow: float = 1.0,
    z: float = 0.0,
) -> Stroke:
    """A stroke through corners at one height, at one speed or one for each stretch."""
    points = np.column_stack([np.array(corners, dtype=np.float64), np.full(len(corners), z)])
    speed = np.broadcast_to(np.asarray(speed_mm_s, dtype=np.float64), len(corners) - 1)
    return Stroke(number, role, points, speed.copy(), flow)


LIFT_MM: Final = 2.0
"""Above what is written, between two strokes."""
_TRAVEL_MM_S: Final = 10.0


def pattern_path(pattern: Pattern, ink: Ink) -> Toolpath:
    """Write each stroke: prime, wait as the ink asks, write, relieve, lift, go to the next.

    A bridge's sources are its layers, of others the strokes in their order: a print may be held
    between two of them.
    """
    layered = pattern.name == "bridge"
    height = pattern.bead.layer_mm if layered or not pattern.bead.round_bead else 0.0
    builder = MoveBuilder(pattern.strokes[0].points[0], "layer", height)
    for order, stroke in enumerate(pattern.strokes):
        z = stroke.points[0, 2]
        source = round(z / pattern.bead.layer_mm) if layered else order
        if order:
            up = max(builder.tip[2], z) + LIFT_MM
            over = np.array([[*builder.tip[:2], up], [*stroke.points[0, :2], up], stroke.points[0]])
            builder.travel(over, _TRAVEL_MM_S, source)
        builder.plunge(ink.retract_ul, ink.plunger_ul_s, source)
        builder.dwell(ink.dwell_s, source)
        way = np.linalg.norm(np.diff(stroke.points, axis=0), axis=1)
        volume = way * pattern.bead.area_mm2 * stroke.flow
        builder.write(stroke.points[1:], volume, stroke.speed_mm_s, source)
        builder.plunge(-ink.retract_ul, ink.plunger_ul_s, source)
    return builder.build()
