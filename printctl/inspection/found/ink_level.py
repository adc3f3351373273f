"""Find blobs and lumens by each pixel's level between bath and ink."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from printctl.inspection.found.blobs import find_blobs
from printctl.inspection.found.lumens import measure_lumens
from printctl.inspection.found.plane_map import PlaneMap
from printctl.inspection.ink.learn import LayerFit
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.values import Blob, FloatImage, Lumen, LumenFinding

_MIN_MIDDLE_SHARE: Final = 0.5
"""Least level in a profile's middle, relative to its highest, for using levels."""
_MIN_CONTRAST_SDS: Final = 2.0
"""Least contrast of ink, in standard deviations of the ground, for using levels."""
_CLEAR_WIDTHS: Final = 0.9
"""Distance from a line's middle, in widths, beyond which bath is expected."""


@dataclass(frozen=True)
class InkLevel:
    """Level of each pixel between bath and ink, where ink shows by its level.

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
    def of(look: LayerFit) -> InkLevel:
        """Project the view on the middle of the ink's profile."""
        profile = look.view_fit.model.profile[0, 0]
        middle = profile[:3].mean(axis=0)
        power = float(middle @ middle)
        filled = power > _MIN_MIDDLE_SHARE**2 * float((profile**2).sum(axis=1).max())
        if not filled or power < _MIN_CONTRAST_SDS**2 or look.odd:
            return InkLevel(None, math.inf)
        level = (look.flat_view.image @ (middle / power)).astype(np.float32)
        return InkLevel(level, 1.0 / math.sqrt(power))

    def blobs(
        self, look: LayerFit, samples: PathSamples, rate: float, thickness_mm: float | None
    ) -> tuple[Blob, ...]:
        """Find ink where none is expected; in heights also on top of lines."""
        view, shifted, px_mm = look.view, look.shifted, 1.0 / look.view.px_per_mm
        if thickness_mm is None:
            image, clear = self.level, _CLEAR_WIDTHS
        else:
            rest = (look.flat_view.image - look.view_fit.ink)[:, :, 0] / look.flat_view.mix[0, 0]
            image, clear = np.where(view.lost, 0.0, rest).astype(np.float32), -math.inf
        if image is None:
            return ()
        free = ((shifted.passes.near.min(axis=2) > clear) & ~view.lost).astype(np.uint8)
        ends = np.stack([shifted.pieces.start, shifted.pieces.end], axis=1)
        lines = draw_lines(view.shape, ends, shifted.pieces.width)
        return find_blobs(
            image, free, view.lost, lines, float(np.median(samples.width)) / px_mm,
            PlaneMap.of(look.frame, shifted.samples, px_mm), rate, thickness_mm or math.nan,
        )  # fmt: skip

    def lumens(
        self, look: LayerFit, lumens: Sequence[Lumen], u_line_mm: float
    ) -> tuple[LumenFinding, ...]:
        """Measure the openness of lumens, given the lines' width uncertainty ``u_line_mm``."""
        by = np.array([look.shift.dx_mm, look.shift.dy_mm])
        older = (look.shifted.over > 0.5).astype(np.uint8)
        return measure_lumens(
            lumens, self.level, look.view.lost, older, look.frame, by, 1.0 / look.view.px_per_mm,
            self.noise, u_line_mm,
        )  # fmt: skip
