"""Doubt a layer's place and widths where light from the side may take flanks for lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from registration.layer_images.seen_layer import SeenLayer
from registration.layer_images.values import Shift
from registration.layer_images.widths.widths import Widths

_SLANT: Final = 0.08
"""Lack of symmetry from which on light from the side must be reckoned with."""
_LIT_ASIDE: Final = 0.3
"""Of a width and of the slant: uncertainty of where a line lies that is lit from the side."""
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
    """Widen the uncertainty of widths where the shaded sides of lines may look like bath.

    Lines then seem thinner, never thicker, and moved across themselves, to the light, by half of
    that. A shift and a deviation that could both come from it are doubted by as much as the
    profiles' lack of symmetry says.
    """
    rows = look.group.first
    ratio = look.widths.width_mm / look.ways.width[rows]
    told = np.isfinite(ratio)
    if look.bath is None or not told.any():
        return look.widths
    across = look.ways.normal[rows[told]] @ np.array([shift.dx_mm, shift.dy_mm])
    moved = float(np.sqrt(np.mean(across**2))) / float(np.median(look.ways.width))
    off = max(0.0, 1.0 - float(np.median(ratio[told])))
    doubt = min(2.0 * moved, off) * min(look.bath.template.slant / _SLANT, 1.5)
    return replace(look.widths, common=float(np.hypot(look.widths.common, doubt)))
