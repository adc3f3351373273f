"""Data class of a patch: a gap's stretch of the job's own path, with overlaps on sound ink."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.observe.mending.gap import Gap
from printctl.observe.mending.laid_ink import LaidInk, stretch_of
from printctl.observe.mending.written_paths import LEAST_MM, WrittenPath

_FEW_STEPS: Final = 40
"""Of the plunger, below which a patch is made of whole ones: one more or less is seen."""
_SPARE: Final = 0.1
"""Of a step that may be missing."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Stretch of a path that is written again.

    Attributes
    ----------
    gap : Gap
    path : WrittenPath
    from_mm, to_mm : float, mm
        Along the path, overlaps included.
    flow : float
        Ink over the path's own; 1 but for a second pass and for whole motor steps.
    backwards : bool
        Whether it is written from its end to its beginning.
    """

    gap: Gap
    path: WrittenPath
    from_mm: float
    to_mm: float
    flow: float = 1.0
    backwards: bool = False

    @property
    def before_mm(self) -> float:
        """Overlap on sound ink before the gap, mm."""
        return max(0.0, self.gap.from_mm - float(self.cuts[0]))

    @property
    def beyond_mm(self) -> float:
        """Overlap on sound ink behind the gap, mm."""
        return max(0.0, float(self.cuts[-1]) - self.gap.to_mm)

    @property
    def cuts(self) -> FloatArray:
        """Ways along the path of its points, in the path's direction, mm."""
        spare = max(0.0, self.gap.from_mm - self.from_mm), max(0.0, self.to_mm - self.gap.to_mm)
        return self.path.cuts(self.from_mm, self.to_mm, LEAST_MM, spare)

    def moves(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points (m + 1, 3) mm, E (m,) mm and feed (m,) mm/s, in the order of writing."""
        cuts = self.cuts
        piece = self.path.piece((cuts[:-1] + cuts[1:]) / 2)
        points = self.path.at(cuts)
        more = self.flow * self.gap.flow
        e = self.path.e_per_mm[piece] * np.diff(cuts) * more
        feed = self.path.feed_mm_s[piece] / max(more, 1.0)  # the plunger goes no faster
        if self.backwards:
            return points[::-1], e[::-1], feed[::-1]
        return points, e, feed

    def ink(self) -> LaidInk:
        """Ink that it is expected to lay, as sound ink of the job lies."""
        stretch = stretch_of(self.path, self.from_mm, self.to_mm)
        return replace(stretch, width_mm=stretch.width_mm * min(self.flow, 1.0))

    @property
    def lowest_mm(self) -> float:
        """Lowest place of the tip, mm."""
        return float(self.path.at(self.cuts)[:, 2].min())


def in_whole_steps(
    patch: Patch, steps_per_mm: float, room: tuple[float, float]
) -> tuple[Patch, ...]:
    """Return short patches that take a whole number of the plunger's motor steps, the best first.

    A gap of 0.2 mm is about one step of a usual plunger: between two patches of equal E the motor
    makes one step more or less. Overlaps are made longer up to ``room`` (mm along the path), and
    what is left over is added to the flow; without room for it a step less comes nearer.
    """
    _, e, _ = patch.moves()
    steps = float(e.sum()) * steps_per_mm
    if not 0 < steps < _FEW_STEPS:
        return (patch,)
    whole = max(1.0, np.ceil(steps - _SPARE))
    more = _longer(patch, steps_per_mm, room, steps, whole)
    less = replace(patch, flow=patch.flow * max(1.0, whole - 1.0) / steps)
    patches = (more,) if whole == 1.0 else (more, less)
    return tuple(sorted(patches, key=lambda one: abs(np.log(one.flow / patch.flow))))


def _longer(
    patch: Patch, steps_per_mm: float, room: tuple[float, float], steps: float, whole: float
) -> Patch:
    """The patch with overlaps for so many steps, as far as there is room, and flow for the rest."""
    low, high = room
    last = float(patch.path.e_per_mm[patch.path.piece(np.array([patch.to_mm]))[0]])
    wanted = max(0.0, (whole - steps) / steps_per_mm / (last * patch.flow * patch.gap.flow))
    beyond = min(wanted, max(0.0, high - patch.to_mm))
    before = min(wanted - beyond, max(0.0, patch.from_mm - low))
    longer = replace(patch, from_mm=patch.from_mm - before, to_mm=patch.to_mm + beyond)
    _, e, _ = longer.moves()
    return replace(longer, flow=longer.flow * whole / (float(e.sum()) * steps_per_mm))


def nearest_steps(patch: Patch, steps_per_mm: float) -> Patch:
    """Return a second pass that takes the nearest whole number of motor steps, one at least."""
    _, e, _ = patch.moves()
    steps = float(e.sum()) * steps_per_mm
    if not 0 < steps < _FEW_STEPS:
        return patch
    return replace(patch, flow=patch.flow * max(1.0, round(steps)) / steps)
