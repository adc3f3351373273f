"""Read blobs and lumens from how much like ink each pixel looks by its level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from registration.inspection.found.blobs import find_blobs
from registration.inspection.found.lumens import see_lumens
from registration.inspection.found.plane_map import PlaneMap
from registration.inspection.ink.learn import Learned
from registration.inspection.pictures.picture import drawn_lines
from registration.inspection.values import Blob, FloatImage, Lumen, LumenSeen
from registration.inspection.ways import Ways

_FILLED: Final = 0.5
"""Of a profile's highest level, that its middle has where ink is told by its level."""
_FAINT: Final = 2.0
"""Standard deviations of the ground that ink must differ by for that."""
_CLEAR: Final = 0.9
"""Widths from a line's middle, from which on there should be bath alone."""


@dataclass(frozen=True)
class InkLevel:
    """How much like ink each pixel looks by its level, where levels tell it.

    Attributes
    ----------
    level : (h, w) float32 or None
        Bath 0, ink 1; None where ink shows by rims or slopes alone.
    noise : float
        Scatter of the bath's single values.
    """

    level: FloatImage | None
    noise: float

    @staticmethod
    def of(look: Learned) -> InkLevel:
        """Project the view on what ink adds in the middle of its profile."""
        profile = look.drawn.model.profile[0, 0]
        middle = profile[:3].mean(axis=0)
        power = float(middle @ middle)
        filled = power > _FILLED**2 * float((profile**2).sum(axis=1).max())
        if not filled or power < _FAINT**2 or look.odd:
            return InkLevel(None, math.inf)
        level = (look.even.image @ (middle / power)).astype(np.float32)
        return InkLevel(level, 1.0 / math.sqrt(power))

    def blobs(
        self, look: Learned, ways: Ways, rate: float, thickness_mm: float | None
    ) -> tuple[Blob, ...]:
        """Find ink where none is expected; on a map of heights also on lines."""
        view, placed, px_mm = look.view, look.placed, 1.0 / look.view.px_per_mm
        if thickness_mm is None:
            image, clear = self.level, _CLEAR
        else:
            rest = (look.even.image - look.drawn.ink)[:, :, 0] / look.even.mix[0, 0]
            image, clear = np.where(view.lost, 0.0, rest).astype(np.float32), -math.inf
        if image is None:
            return ()
        free = ((placed.passes.near.min(axis=2) > clear) & ~view.lost).astype(np.uint8)
        ends = np.stack([placed.pieces.start, placed.pieces.end], axis=1)
        lines = drawn_lines(view.shape, ends, placed.pieces.width)
        return find_blobs(
            image, free, view.lost, lines, float(np.median(ways.width)) / px_mm,
            PlaneMap.of(look.frame, placed.ways, px_mm), rate, thickness_mm or math.nan,
        )  # fmt: skip

    def lumens(
        self, look: Learned, lumens: Sequence[Lumen], u_line_mm: float
    ) -> tuple[LumenSeen, ...]:
        """Measure how far each is open, where lines' widths are known to ``u_line_mm``."""
        by = np.array([look.shift.dx_mm, look.shift.dy_mm])
        older = (look.placed.over > 0.5).astype(np.uint8)
        return see_lumens(
            lumens, self.level, look.view.lost, older, look.frame, by, 1.0 / look.view.px_per_mm,
            self.noise, u_line_mm,
        )  # fmt: skip
