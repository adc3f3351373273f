"""Run one layer picture's evaluation: light, shift, ink, then gaps, widths, blobs, lumens.

1. Places along the fresh lines, closely spaced; the picture cropped and binned to them (`working`).
2. Uneven light is taken out (`light`), and the layer's shift found roughly (`coarse_shift`).
3. Ink is learned from the lines themselves, some of which may be missing (`ink_image`), over the
   bath and over older ink separately (`told`). Ink that can't be told is "not seen".
4. The shift is fitted to the offsets of the lines, and 2 and 3 are done again (`layer_shift`).
5. Gaps, widths, stretches (of lines that touch by the bath at their `seams`), blobs and lumens,
   each against the noise of the same picture.

What a picture can't show: height (a thin line is as wide as a thick one that is flat), widths of
lines that touch (only whether they are thinner than the rest of the layer), ink of the bath's own
colour and texture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray
from registration.errors import PictureError
from registration.inspection.findings import LayerFindings
from registration.inspection.layer_findings import findings_of
from registration.inspection.lit_from_the_side import honest_shift, may_be_ridges
from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.before import with_before
from registration.inspection.pictures.working import Outlines, Working, prepare
from registration.inspection.place.first_shift import first_shift
from registration.inspection.place.layer_shift import PLENTY, fit_shift
from registration.inspection.ridges.ridge_light import ridge_light
from registration.inspection.ridges.ridge_shading import RidgeLight
from registration.inspection.seen_layer import SeenLayer, seen_at_shift
from registration.inspection.unseen.out_of_place import ink_beside_mm, unless_elsewhere
from registration.inspection.values import Appearance, ExpectedLines, Frame, Image, Lumen, Shift
from registration.inspection.ways import check_lines, lay_ways

_STEPS_IN_GAP: Final = 4
_SAME_PX: Final = 0.4
"""A shift that changes by less isn't followed further."""
_ROUNDS: Final = 3
_DESIGNED: Final = Shift(0.0, 0.0, np.zeros((2, 2)))
"""Where a layer's outlines alone tell a shift, its gaps must be there without it, too."""


def see_layer(
    picture: Image,
    frame: Frame,
    lines: ExpectedLines,
    *,
    lumens: Sequence[Lumen] = (),
    before: Image | None = None,
    stood_still: Callable[[], bool] | None = None,
    since: BoolArray | None = None,
    hidden: Outlines | BoolArray = (),
    known: Appearance | None = None,
    thickness_mm: float | None = None,
    options: SeeingOptions | None = None,
) -> LayerFindings:
    """Judge a picture of a layer.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) uint8, uint16 or float
        A float picture is taken as it is, NaN as not seen; one of two channels is a `height_map`:
        the first tells ink from bath, as of a `surface_of`. Of others the logarithm.
    frame : Frame
    lines : ExpectedLines
        Of the layer, and what older lines can be seen.
    lumens : sequence of Lumen
    before : picture or None
        The same view before the layer was written: what lay there then cancels, and fresh ink over
        older ink is told by what changed.
    stood_still : function or None
        Tells by marks whether the camera stood still in between; asked where a move is fitted.
    since : (n,) bool or None
        Older lines that were written after ``before`` was taken (mends); None for none.
    hidden : sequence of (k, 2) float64, px, or (h, w) bool
        Polygons of the picture behind which nothing can be seen (the needle), or its pixels.
    known : Appearance or None
        Of an earlier look in the same light: a layer that is missing altogether can't be learned
        from.
    thickness_mm : float or None, mm
        Of the layer, where the picture is a `height_map`: fresh ink over older ink is then told by
        its height.
    options : SeeingOptions or None

    Raises
    ------
    PictureError
        When lines or picture can't be used, or the picture shows none of the lines.
    """
    options = options or SeeingOptions()
    check_lines(lines)
    rng = np.random.default_rng(26)
    step = options.gap_mm / _STEPS_IN_GAP
    ways = lay_ways(lines, step)
    work, own = prepare(picture, frame, ways, options.gap_mm, hidden)
    late = np.zeros(len(lines), dtype=np.bool_) if since is None else since & ~lines.fresh
    if before is not None:
        work = with_before(work, own, picture, before, lines, lines.fresh | late, stood_still)
    _check_thickness(thickness_mm, work)

    def seen_at(shift: Shift, light: RidgeLight | None = None) -> SeenLayer:
        return seen_at_shift(
            work, own, lines, late, ways, shift, options, known, thickness_mm, rng, light
        )

    first = first_shift(work, own, lines, ways, options)
    look, shift, finer = _at_finest(seen_at, first, options, work)
    light = None
    if may_be_ridges(look, shift) and not options.round_lines:
        light = ridge_light(work, own, lines, ways, look.masks, look.flat, shift, rng)
    if light is not None:
        look, honest = seen_at(light.shift, light), light.shift
    else:
        honest = honest_shift(shift, look, options.shift_mm)
    found = findings_of(look, lumens, honest, options)
    if work.flanks_lost and thickness_mm and found.gaps:
        found = replace(found, beside_mm=ink_beside_mm(look, lines, thickness_mm))
        if finer is None and (shift.dx_mm or shift.dy_mm):
            rival = findings_of(seen_at(_DESIGNED), (), _DESIGNED, options)
            found = unless_elsewhere(found, rival)
    return found


def _at_finest(
    seen_at: Callable[[Shift], SeenLayer], shift: Shift, options: SeeingOptions, work: Working
) -> tuple[SeenLayer, Shift, Shift | None]:
    """Look at a shift and at finer ones until they settle; look, shift, the last finer one."""
    for _ in range(_ROUNDS):
        look = seen_at(shift)
        finer = _finer(look, shift, options, work)
        if finer is None:
            return look, shift, None
        moved = np.hypot(finer.dx_mm - shift.dx_mm, finer.dy_mm - shift.dy_mm) * work.px_per_mm
        shift = finer
        if moved < _SAME_PX:
            return look, shift, finer
    return seen_at(shift), shift, finer


def _check_thickness(thickness_mm: float | None, work: Working) -> None:
    if thickness_mm is not None and (work.height is None or not thickness_mm > 0):
        raise PictureError(
            f"thickness_mm is {thickness_mm:g} and the picture no height map; thickness_mm > 0 mm "
            "goes with a picture of `height_map` alone"
        )


def _finer(look: SeenLayer, shift: Shift, options: SeeingOptions, work: Working) -> Shift | None:
    offset = look.widths.offset_mm
    rows = look.group.first
    rest = fit_shift(
        offset, look.ways.normal[rows], look.ways.stroke[rows], options.shift_mm, 1 / work.px_per_mm
    )
    if rest is None:
        return None
    few = np.isfinite(offset).sum() < PLENTY
    if few and np.trace(rest.covariance_mm2) > np.trace(shift.covariance_mm2):
        return None
    return Shift(shift.dx_mm + rest.dx_mm, shift.dy_mm + rest.dy_mm, rest.covariance_mm2)
