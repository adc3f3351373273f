"""Small handwritten jobs, in layers and in a bath, held at a mark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.machine.job.job import parse_job
from printctl.machine.job.marks import MarkKind
from printctl.observe.mending import HeldPrint

PRINTER = load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
NEEDLE = load(Needle, "30g_50mm")
INK = load(Ink, "collagen_fresh")
LAYER_MM = 0.2
WIDTH_MM = 0.3
RELIEF_E = INK.retract_ul / SYRINGE.area_mm2


@dataclass
class JobText:
    """G-code of strokes, each with a relief behind it and a prime before it."""

    area_mm2: float
    lift_mm: float = 0.5
    lines: list[str] = field(
        default_factory=lambda: ["G21", "G90", "M82", "G92 X100 Y100 Z30 E0", "G0 Z31 F300"]
    )
    e: float = 0.0
    first: bool = True

    def stroke(self, points: Sequence[Sequence[float]], mark: str = "", feed: int = 600) -> None:
        """Write a path."""
        at = np.array(points, dtype=float)
        self.lines += ["G0 X{:.3f} Y{:.3f} F2400".format(*at[0]), f"G0 Z{at[0, 2]:.4f} F300"]
        if not self.first:
            self.e += RELIEF_E
            self.lines.append(f"G1 E{self.e:.7f} F1.4")
        self.first = False
        for begin, end in pairwise(at):
            self.e += float(np.linalg.norm(end - begin)) * self.area_mm2 / SYRINGE.area_mm2
            x, y, z = end
            self.lines.append(f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f} E{self.e:.7f} F{feed}")
        self.e -= RELIEF_E
        self.lines.append(f"G1 E{self.e:.7f} F1.4")
        self.lines.append(f"G0 Z{at[:, 2].max() + self.lift_mm:.4f} F300")
        if mark:
            self.lines.append(f";{mark}")

    def held(self, *, after: int | None = None, **changes: object) -> HeldPrint:
        """Hold at the last mark, or at mark ``after``."""
        job = parse_job("\n".join([*self.lines, "M400"]).encode(), "small", PRINTER)
        mark = job.marks.all[-1 if after is None else after]
        parts: dict[str, object] = {"syringe": SYRINGE, "ink": INK, "needle": NEEDLE} | changes
        parts["style"] = "layered" if mark.kind is MarkKind.LAYER else "embedded"
        return HeldPrint(job.lines, mark.index, PRINTER, **parts)  # type: ignore[arg-type]


def line_area_mm2() -> float:
    """Cross-section of a layer's line."""
    return float(INK.bead_section.area(WIDTH_MM, LAYER_MM))


def zigzag(layer: int, rows: int = 6, long_mm: float = 8.0) -> list[tuple[float, float, float]]:
    """Infill of one layer, lines 0.5 mm apart, every second layer the other way round."""
    z = 5.0 + LAYER_MM * (layer + 1)
    found = []
    for row in range(rows):
        ends = [(0.0, 0.5 * row), (long_mm, 0.5 * row)]
        for a, b in ends if row % 2 == 0 else ends[::-1]:
            x, y = (a, b) if layer % 2 == 0 else (b, a)
            found.append((100.0 + x, 100.0 + y, z))
    return found


def layered_job(layers: int = 3) -> JobText:
    """Zigzags on top of each other, with a mark behind each."""
    job = JobText(line_area_mm2())
    for layer in range(layers):
        job.stroke(zigzag(layer), f"LAYER_END:{layer}")
    return job


def bath_job(*paths: Sequence[Sequence[float]], radius_mm: float = 0.2) -> JobText:
    """Filaments in a bath, with a mark behind each."""
    job = JobText(np.pi * radius_mm**2, lift_mm=3.0)
    for number, path in enumerate(paths):
        job.stroke(path, f"PASS_END:{number}", feed=120)
    return job
