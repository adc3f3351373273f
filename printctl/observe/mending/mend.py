"""Data classes of a mend: options, patches, lines to insert, gaps left."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from design.toolpath.priming import Purge
from kernels.arrays import FloatArray
from printctl.observe.mending.gap import Gap, NotMended
from printctl.observe.mending.held_print import LEAST_MM, MendError, WrittenPath
from printctl.observe.mending.laid_ink import LaidInk, joined_ink, stretch_of

# Options of a mend: overlaps, clearances, tolerances, primes and wipes.


@dataclass(frozen=True)
class MendOptions:
    """How gaps are patched.

    Attributes
    ----------
    overlap_widths : float
        How far a patch begins and ends on sound ink, in widths of its line.
    merge_widths : float
        Gaps of a path nearer to each other are one.
    least_mm : float, mm
        Shorter stretches aren't worth a descent of the needle.
    void_tolerance_mm : float, mm
        How far ink may reach into a void, rounding of motor steps included.
    shift_mm : float, mm
        How far the patch may lie beside what was seen, added to the gap's own.
    clearance_mm : float, mm
        Kept between the needle and ink that stands in its way.
    lift_mm : float or None, mm
        Height of travels above all ink; None takes two layers, at least 0.2 mm, or 0.5 mm in a
        bath.
    wipe_widths : float
        Way on along sound ink with the plunger relieved, layers only.
    purge : Purge or None
        Place outside the part (printer's frame) to prime and wipe before the first patch; None
        primes as the job does after a travel, at the patch's beginning.
    room_for_second_pass : float
        Share of a layer's height that must be free above a thin stretch for a second pass.
    """

    overlap_widths: float = 1.0
    merge_widths: float = 2.0
    least_mm: float = 0.05
    void_tolerance_mm: float = 0.05
    shift_mm: float = 0.02
    clearance_mm: float = 0.05
    lift_mm: float | None = None
    wipe_widths: float = 1.0
    purge: Purge | None = None
    room_for_second_pass: float = 0.25

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            number = not isinstance(value, Purge) and value is not None
            if number and not (np.isfinite(value) and value >= 0):
                raise MendError(f"mends: {name} is {value:g}; give a number of 0 or more")

    def travel_lift_mm(self, layer_mm: float, *, layered: bool) -> float:
        """Height above all ink at which the needle travels, mm."""
        if self.lift_mm is not None:
            return self.lift_mm
        return max(0.2, 2 * layer_mm) if layered else 0.5


# Data class of a patch: a gap's stretch of the job's own path, with overlaps on sound ink.

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


@dataclass(frozen=True, eq=False)
class Mend:
    """Insert that mends gaps.

    Attributes
    ----------
    lines : tuple of bytes
        To be inserted where the print is held; none where nothing can be mended.
    patches : tuple of Patch
        In the order in which they are written.
    spans : tuple of (int, int)
        Lines of the insert that write each patch: the first, and the one behind the last.
    left : tuple of NotMended
    volume_ul : float, µL
        Ink that comes out of the needle, a purge's included.
    duration_s : float, s
        Of the insert, by the dry run.
    """

    lines: tuple[bytes, ...]
    patches: tuple[Patch, ...]
    spans: tuple[tuple[int, int], ...]
    left: tuple[NotMended, ...]
    volume_ul: float
    duration_s: float

    def ink(self) -> LaidInk:
        """Return the ink that is expected to lie there after the mend, besides what did."""
        if self.patches:
            return joined_ink([patch.ink() for patch in self.patches])
        nothing = np.zeros((0, 3))
        return LaidInk(nothing, nothing, np.zeros(0), np.zeros(0), np.zeros(0, np.int64))

    def as_dict(self) -> dict[str, Any]:
        """Return what a journal keeps of it, JSON-ready."""
        return {
            "lines": [line.decode("ascii") for line in self.lines],
            "patches": [_patch_facts(patch) for patch in self.patches],
            "left": [asdict(one) for one in self.left],
            "volume_ul": round(self.volume_ul, 5),
            "duration_s": round(self.duration_s, 2),
        }

    def sentences(self) -> list[str]:
        """Return the mend in words, for the operator."""
        said = [
            f"path {p.path.number}: {p.gap.length_mm:.2f} mm written again, with {p.before_mm:.2f} "
            f"and {p.beyond_mm:.2f} mm on sound ink"
            for p in self.patches
        ]
        if self.patches:
            said.append(f"{self.volume_ul:.3f} µL of ink, {self.duration_s:.0f} s")
        return said + [
            f"path {one.path}: {one.length_mm:.2f} mm not mended: {one.reason}" for one in self.left
        ]

    def left_words(self) -> str:
        """Return how much isn't mended, by reason; empty for nothing."""
        ways = dict[str, float]()
        for one in self.left:
            ways[one.reason] = ways.get(one.reason, 0.0) + one.length_mm
        return "; ".join(f"{way:.2f} mm ({reason})" for reason, way in ways.items())


def _patch_facts(patch: Patch) -> dict[str, Any]:
    return {
        "path": patch.path.number,
        "from_mm": round(float(patch.gap.from_mm), 4),
        "to_mm": round(float(patch.gap.to_mm), 4),
        "before_mm": round(float(patch.before_mm), 4),
        "beyond_mm": round(float(patch.beyond_mm), 4),
        "flow": round(float(patch.flow), 4),
        "backwards": patch.backwards,
    }
