"""Data classes: G-code with the map from lines to design parts, and the writer's options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from design.toolpath.toolpath import check_fields
from firmware_profiles import Syringe
from kernels.arrays import IntArray


@dataclass(frozen=True)
class Gcode:
    r"""G-code bytes and the map of their lines.

    Attributes
    ----------
    data : bytes
        ASCII, every line ended by ``\n``; no comments but marks, and no empty lines.
    line_source : (lines,) int64
        Layer or vessel of each line; -1 for none, as for a mark.
    line_move : (lines,) int64
        The toolpath's move that each line ends; -1 for none. A line may end several moves.
    line_kind : (lines,) int64
        Why the line is there, a `MoveKind`: that move's; -1 for none.
    source_kind : "layer" or "vessel"
        What `line_source` counts.
    """

    data: bytes
    line_source: IntArray
    line_move: IntArray
    line_kind: IntArray
    source_kind: Literal["layer", "vessel"]

    @property
    def line_count(self) -> int:
        """Number of commands; marks aren't counted."""
        return len(self.line_move) - self.data.count(b";") - self.data.count(b"//")

    @staticmethod
    def joined(parts: Sequence[Gcode]) -> Gcode:
        """One job of its parts, in their order."""
        return Gcode(
            b"".join(part.data for part in parts),
            np.concatenate([part.line_source for part in parts]),
            np.concatenate([part.line_move for part in parts]),
            np.concatenate([part.line_kind for part in parts]),
            parts[0].source_kind,
        )


@dataclass(frozen=True)
class HeadLoad:
    """Syringe and ink of one head.

    Attributes
    ----------
    syringe : Syringe
    flow_factor : float
        As in `GcodeOptions`, of this head's ink.
    relieve_ul, plunger_ul_s : float, µL, µL/s
        As in `GcodeOptions`: relief before the head is left, where the toolpath has none.
    flow_ul_s, ink_speed_mm_s
        As in `GcodeOptions`, of a pneumatic head.
    """

    syringe: Syringe
    flow_factor: float = 1.0
    relieve_ul: float = 0.02
    plunger_ul_s: float = 0.4
    flow_ul_s: float | None = None
    ink_speed_mm_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        flow = "" if self.flow_ul_s is None else " flow_ul_s"
        check_fields("head's load", self, f"flow_factor plunger_ul_s{flow}", "relieve_ul")


@dataclass(frozen=True)
class GcodeOptions:
    """Options of the G-code writer.

    Attributes
    ----------
    start_mm : (x, y, z) or None, mm
        Where the tip stands when the job begins, in the printer's frame. With a value the job
        declares it to the firmware (G92): for a simulated printer, or after a touch-off at a
        known place. Without one the firmware must know its position already.
    clearance_mm : float, mm
        Height above the whole toolpath at which the tip comes and goes.
    travel_speed_mm_s : float, mm/s
        To the first point.
    relieve_ul : float, µL
        Plunger relief at the end, so that nothing weeps while the needle is lifted.
    plunger_ul_s : float, µL/s
        Flow of that relief.
    flow_factor : float
        What comes out over what is pushed (a calibration's); the plunger's travel is divided by it.
    flow_ul_s : float or None, µL/s
        What a pneumatic head lays while its valve is open; without meaning for a plunger.
    ink_speed_mm_s : (low, high) or None, mm/s
        Speeds that the ink bears; a pneumatic head's follow from the flow and are refused beyond.
    standing_doses : bool
        Whether a pneumatic head's valve opens for primes, each for its time: a weighing. Else
        they are left out.
    heads : tuple of HeadLoad
        What each of several heads holds; empty for one, or for the same in each.
    safe_z_mm : float or None, mm
        Height, printer's frame, below which no tip may be where heads are changed: the dish's wall
        and more. None where only what is written counts.
    header : tuple of str
        Comment lines before the first command, without the comment character.
    """

    start_mm: tuple[float, float, float] | None = None
    clearance_mm: float = 5.0
    travel_speed_mm_s: float = 20.0
    relieve_ul: float = 0.02
    plunger_ul_s: float = 0.4
    flow_factor: float = 1.0
    flow_ul_s: float | None = None
    ink_speed_mm_s: tuple[float, float] | None = None
    standing_doses: bool = False
    heads: tuple[HeadLoad, ...] = ()
    safe_z_mm: float | None = None
    header: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        flow = "" if self.flow_ul_s is None else "flow_ul_s"
        positive = f"travel_speed_mm_s plunger_ul_s flow_factor {flow}"
        check_fields("G-code options", self, positive, "clearance_mm relieve_ul")
