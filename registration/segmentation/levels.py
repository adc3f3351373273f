"""Find the grey levels of gel and liquid, and refuse a scan without contrast between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.errors import SegmentationError
from registration.segmentation.classes import split_classes


@dataclass(frozen=True)
class Levels:
    """Two classes of grey values.

    Attributes
    ----------
    lumen, gel : float
        Typical value of each class.
    contrast : float
        Their distance over the spread of the gel.
    """

    lumen: float
    gel: float
    contrast: float

    @property
    def half(self) -> float:
        """The surface's level, halfway between the classes."""
        return (self.lumen + self.gel) / 2


def sparse_levels(values: FloatArray) -> Levels:
    """Classes where lumens fill a small share (micro-CT of vessels in gel).

    The gel is the bulk, so median and spread are its own; lumen is what lies far below it, and
    its level is the median of what is nearer to the darkest than to the gel, because the
    borders are mixtures.
    """
    gel = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - gel)))
    dark = values[values < gel - 6 * max(spread, 1e-6 * abs(gel))]
    if len(dark) < 100:
        raise SegmentationError(
            f"no lumen stands out: {len(dark)} of {len(values)} sampled voxels lie six standard "
            "deviations from the gel; check the scan, or say lumens='bright' if they are filled "
            "with contrast agent"
        )
    half = (gel + float(np.percentile(dark, 2))) / 2
    return _levels(dark[dark < half], values[values > half])


def part_levels(values: FloatArray) -> Levels:
    """Classes of a whole part in liquid, of which either may fill most of the field.

    The classes' own medians, as borders are mixtures. Where the values are of one class and few
    others, the part fills the field, and they are lumens in it.
    """
    split = split_classes(values)
    if not split.two:
        return sparse_levels(values)
    return _levels(values[values <= split.middle], values[values > split.middle])


def _levels(lumen: FloatArray, gel: FloatArray) -> Levels:
    if len(lumen) == 0 or len(gel) == 0:
        raise SegmentationError("the scan has one grey value only; nothing can be told apart")
    low, high = float(np.median(lumen)), float(np.median(gel))
    spread = 1.4826 * float(np.median(np.abs(gel - high)))
    return Levels(low, high, (high - low) / max(spread, 1e-9 * abs(high)))
