"""Doubt a layer's place and widths where light from the side may take flanks for lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.values import Shift
from registration.inspection.widths.widths import Widths

_SLANT: Final = 0.08
"""Lack of symmetry from which on light from the side must be reckoned with."""
_LIT_ASIDE: Final = 0.3
"""Of a width and of the slant: uncertainty of where a line lies that is lit from the side."""
_WIDENED: Final = 2.5
"""Times the move, by which a shadow widens lines at most: half of it lies on either side."""
_FEWEST: Final = 8
"""Stations of a direction that tell how wide its lines are."""
_APART: Final = 0.25
"""Of the largest move of lines across themselves, by which those of two directions must differ."""
_MOVED: Final = 0.2
"""Widths, by which a look that takes bright flanks for lines may have moved the layer."""


def may_be_ridges(look: SeenLayer, shift: Shift) -> bool:
    """Whether a picture of light may be one of ridges lit from the side, by a symmetric look."""
    if not look.work.is_log or look.ways.varied:
        return False
    told = look.bath
    moved = float(np.hypot(shift.dx_mm, shift.dy_mm)) / float(np.median(look.ways.width))
    if told is None or told.noise is None or told.faint or moved > _MOVED:
        return True
    return told.template.by_edges or told.template.slant > _SLANT


def honest_shift(shift: Shift, look: SeenLayer, reach_mm: float) -> Shift:
    """Widen the shift of lines lit from the side: their middle isn't where it seems.

    Lines that aren't seen at all may lie anywhere within reach.
    """
    told = look.bath
    if all(one is None or one.noise is None for one in (told, look.old)):
        return replace(shift, covariance_mm2=shift.covariance_mm2 + reach_mm**2 * np.eye(2))
    if told is None:
        return shift
    width = float(np.median(look.ways.width))
    slant, moved = min(told.template.slant, 1.0), float(np.hypot(shift.dx_mm, shift.dy_mm))
    if slant < _SLANT:  # no shade: at most half of a line could look like bath
        moved = min(moved, 0.5 * width)
    u = np.hypot(_LIT_ASIDE * slant * width, 0.5 * moved * min(slant / _SLANT, 1.0))
    return replace(shift, covariance_mm2=shift.covariance_mm2 + u**2 * np.eye(2))


def lit_widths(look: SeenLayer, shift: Shift) -> Widths:
    """Widen the uncertainty of widths where light from the side may make lines thinner or thicker.

    The shaded sides of lines may look like bath: lines then seem thinner, and moved across
    themselves, to the light, by half of that. A shift and a deviation that could both come from it
    are doubted by as much as the profiles' lack of symmetry says. A shadow beside a line may look
    like its ink: lines then seem thicker, and moved away from the light, those along the light not.
    """
    rows = look.group.first
    ratio = look.widths.width_mm / look.ways.width[rows]
    told = np.isfinite(ratio)
    if look.bath is None or not told.any():
        return look.widths
    across = look.ways.normal[rows[told]] @ np.array([shift.dx_mm, shift.dy_mm])
    moved = float(np.sqrt(np.mean(across**2))) / float(np.median(look.ways.width))
    off = float(np.median(ratio[told])) - 1.0
    doubt = min(2.0 * moved, max(-off, 0.0)) * min(look.bath.template.slant / _SLANT, 1.5)
    if off > 0.0:
        by_shadow = _by_direction(np.abs(across), ratio[told])
        if by_shadow is None:
            slant = look.bath.template.slant / _SLANT
            by_shadow = 2.0 * moved * min(max(slant - 1.0, 0.0), 1.0)
        doubt = min(by_shadow, _WIDENED * moved, off)
    return replace(look.widths, common=float(np.hypot(look.widths.common, doubt)))


def _by_direction(across_mm: FloatArray, ratio: FloatArray) -> float | None:
    """How much wider lines are than such along the shift would be; None for lines of one direction.

    ``across_mm`` is how far each is moved across itself, and ``ratio`` its width over the expected
    one, (n,) each.
    """
    middle = 0.5 * float(across_mm.min() + across_mm.max())
    least, most = (across_mm[rows] for rows in (across_mm <= middle, across_mm > middle))
    apart = float(np.median(most) - np.median(least)) if len(most) else 0.0
    if min(len(least), len(most)) < _FEWEST or apart < _APART * float(across_mm.max()):
        return None
    wider = float(np.median(ratio[across_mm > middle]) - np.median(ratio[across_mm <= middle]))
    return max(0.0, wider / apart * float(np.median(across_mm)))
