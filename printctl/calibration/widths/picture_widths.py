"""Measure line widths and gaps of a printed calibration pattern in a picture of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from design.files import write_bytes, write_text
from kernels.arrays import FloatArray
from printctl.calibration.patterns import (
    Pattern,
    Stroke,
    WrittenPattern,
    filled_text,
    width_row,
)
from printctl.calibration.patterns.plan import MARGIN_MM
from printctl.calibration.widths.result import Replies, Widths
from printctl.errors import UsageError
from registration.devices.lens import Lens
from registration.devices.microscope import (
    Crossing,
    GapWidth,
    Line,
    LineWidths,
    Shade,
    Target,
    View,
    annotated,
    find_view,
    marked_view,
    measure_gaps,
    measure_lines,
    read_picture,
)

_REACH: Final = 2.6
"""Widths to either side of a line: a step's thick begin is twice as wide."""
_POINTS_MM: Final = 0.25
_MISFIT: Final = 0.05
_VAGUE: Final = 0.02
_SCALES: Final = 0.03
_T95: Final = 1.96


@dataclass(frozen=True)
class MeasuredPicture:
    """Widths and gaps measured in a picture.

    Attributes
    ----------
    measured : Widths or Replies
        Replies of comb and joint.
    table : str
        The sheet, filled in.
    picture : (h, w, 3) uint8
        With what was measured drawn into it.
    notes : list of str
    """

    measured: Widths | Replies
    table: str
    picture: Any
    notes: list[str]

    def save(self, path: Path) -> tuple[Path, Path]:
        """Write NAME.measured.png and the filled sheet, NAME.widths.csv, beside the picture."""
        drawn, sheet = path.with_suffix(".measured.png"), path.with_suffix(".widths.csv")
        _, data = cv2.imencode(".png", self.picture)
        write_bytes(drawn, data.tobytes())
        write_text(sheet, self.table)
        return drawn, sheet


@dataclass(frozen=True)
class PictureFacts:
    """What the user says of a picture.

    Attributes
    ----------
    um_per_px : float or None
        By a stage micrometer; the frame's size as printed without.
    marks_px : (4, 2) float64 or None
        Corners of the frame.
    lens : Lens or None
        Of the camera, with its scale.
    """

    um_per_px: float | None = None
    marks_px: FloatArray | None = None
    lens: Lens | None = None


def measure_picture(path: Path, written: WrittenPattern, given: PictureFacts) -> MeasuredPicture:
    """Find the pattern in a picture and measure it.

    Raises
    ------
    PictureError
        When the picture can't be read or shows something else.
    UsageError
        For a bridge, which a picture from above doesn't tell; for a scale that isn't the frame's.
    """
    pattern = written.pattern
    if pattern.name == "bridge":
        raise UsageError(
            "whether a bridge sagged can't be seen from above; look from the side and type 1 or 0 "
            "into the sheet (.csv)"
        )
    lens, marks_px = given.lens, given.marks_px
    picture = read_picture(path, lens)
    target = _target(pattern, written.mounted.swell_factor or 1.0)
    if marks_px is None:
        view = find_view(picture, target)
    else:
        marks_px = marks_px if lens is None else lens.straight_pixels(marks_px)
        view = marked_view(picture, target, marks_px)
    scale, notes = _scale(view, given)
    gaps = [Crossing(one.number, one.lines) for one in pattern.questions]
    lines, shade = measure_lines(picture, view, _lines(pattern, bool(gaps)))
    notes += _notes(view, shade, pattern)
    if not gaps:
        drawn = annotated(picture, view, target, lines, [])
        widths = _widths(lines, scale, shade)
        return MeasuredPicture(widths, _table_of_widths(written, widths), drawn, notes)
    bead = float(np.nanmedian(np.concatenate([one.width_mm for one in lines])))
    contrast = float(np.nanmedian(np.concatenate([one.height for one in lines])))
    wider = bead - float(shade.half_width(np.array([bead]))[0])
    gap_widths = measure_gaps(picture, view, gaps, contrast, wider)
    drawn = annotated(picture, view, target, [], list(zip(gaps, gap_widths, strict=True)))
    replies = _replies(gap_widths, scale, shade.least_gap_mm + 0.5e-3 * view.um_per_px)
    return MeasuredPicture(replies, _table_of_gaps(written, replies), drawn, notes)


def _target(pattern: Pattern, swell: float) -> Target:
    points = []
    for stroke in pattern.strokes:
        flat = stroke.points[:, :2]
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
        at = np.linspace(0, ends[-1], max(2, round(ends[-1] / _POINTS_MM)))
        points.append(np.column_stack([np.interp(at, ends, flat[:, k]) for k in (0, 1)]))
    width = pattern.bead.width_mm * swell
    return Target(pattern.size_mm, width, MARGIN_MM, np.concatenate(points))


def _lines(pattern: Pattern, gaps: bool) -> list[Line]:
    """What to measure: the strokes themselves; of a comb or joint the frame, which stands free."""
    width = pattern.bead.width_mm
    step = max(width / 2, 0.1)
    if gaps:
        frame = [stroke.points[:, :2] for stroke in pattern.of_role("frame")]
        sides = [corners[k : k + 2] for corners in frame for k in (0, 1)]
        inner = [side[0] + np.array([[0.1], [0.9]]) * (side[1] - side[0]) for side in sides]
        reach = min(_REACH * width, 0.4 * MARGIN_MM)
        return [Line(k + 1, side, width, reach, step) for k, side in enumerate(inner)]
    strokes = pattern.of_role("line", "step", "spiral")
    reach = min(_REACH * width, 0.45 * _apart(strokes), 0.9 * MARGIN_MM)
    return [
        Line(s.number, s.points[:, :2], pattern.bead.width_at(s.flow), reach, step) for s in strokes
    ]


def _apart(strokes: Sequence[Stroke]) -> float:
    """Distance between neighbouring lines, or between a spiral's turns, mm."""
    if strokes[0].role == "spiral":
        points = strokes[0].points[:, :2]
        # The inner end lies 1.5 pitches from the middle, to the right of it (`spiral_pattern`).
        gaps = np.hypot(*(points[1:] - points[0]).T)
        turned = np.cumsum(np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T)))))
        return float(gaps[int(np.searchsorted(turned, 2 * np.pi)) + 1])
    heights = np.sort([stroke.points[0, 1] for stroke in strokes])
    return float(np.diff(heights).min()) if len(heights) > 1 else 2 * MARGIN_MM


def _scale(view: View, given: PictureFacts) -> tuple[float, list[str]]:
    """Factor on all lengths: the user's scale over the frame's."""
    scale = given.um_per_px if given.lens is None else given.lens.um_per_px
    if scale is None:
        return 1.0, [
            "the picture is scaled by the frame as printed: widths are as right as the printer's "
            "axes (--um-per-px takes a stage micrometer's word instead, --camera a board's)"
        ]
    source = "--um-per-px" if given.lens is None else "--camera: scale"
    ratio = scale / view.um_per_px
    if abs(ratio - 1) > _SCALES:
        raise UsageError(
            f"{source} {scale:.4g}, and by its frame the picture has {view.um_per_px:.3g} µm a "
            f"pixel ({ratio - 1:+.0%}, {_SCALES:.0%} allowed): is it another pattern's picture, "
            "was it resized, or are the printer's steps wrong (printctl calibrate backlash)?"
        )
    return ratio, [f"the frame is printed {ratio - 1:+.2%} off the scale that was given"]


def _notes(view: View, shade: Shade, pattern: Pattern) -> list[str]:
    width = pattern.bead.width_mm
    kind = "opaque" if shade.opaque(width) else "lets light through"
    notes = [
        f"picture: {view.um_per_px:.3g} µm a pixel{', mirrored' if view.mirrored else ''}; frame "
        f"straight to {view.off_mm * 1e3:.1f} µm; the ink {kind}, blur "
        f"{shade.picture_blur_mm * 1e3:.0f} µm"
    ]
    if _T95 * shade.spread > _VAGUE:
        notes.append(
            f"this picture leaves all widths uncertain by {_T95 * shade.spread:.0%} together: blur "
            "and the ink's clearness can't be told apart; take a sharper one, or more pixels"
        )
    if shade.misfit > _MISFIT:
        notes.append(
            f"the lines don't look like a filament's shade (misfit {shade.misfit:.0%} of its "
            "height): dark edges with a bright middle? Dye the ink, or type the widths"
        )
    return notes


def _widths(lines: Sequence[LineWidths], scale: float, shade: Shade) -> Widths:
    number, x, width, shares = [], [], [], {}
    for one in lines:
        known = np.isfinite(one.width_mm)
        number.append(np.full(int(known.sum()), one.line.number, dtype=np.int64))
        x.append(one.way.along_mm[known])
        width.append(one.width_mm[known] * scale)
        shares[one.line.number] = one.found
    return Widths(
        np.concatenate(number),
        np.concatenate(x),
        np.concatenate(width),
        found=shares,
        optics=_T95 * shade.spread,
    )


def _replies(gaps: Sequence[GapWidth], scale: float, least_mm: float) -> Replies:
    seen = [one for one in gaps if np.isfinite(one.open_mm).all()]
    if len(seen) < len(gaps):
        raise UsageError("a part of the pattern lies outside the picture; have all of it in it")
    return Replies(
        np.array([one.number for one in seen], dtype=np.int64),
        np.array([float(np.median(one.open_mm)) * scale for one in seen]),
        np.array([float((one.open_mm > 0).mean()) for one in seen]),
        least_mm,
    )


def _table_of_widths(written: WrittenPattern, widths: Widths) -> str:
    strokes = {stroke.number: stroke for stroke in written.pattern.strokes if stroke.number}
    swell = written.mounted.swell_factor
    rows = [
        [*width_row(strokes[n], x, written.pattern, swell), f"{width:.5f}"]
        for n, x, width in zip(
            widths.number.tolist(), widths.x_mm.tolist(), widths.width_mm.tolist(), strict=True
        )
    ]
    return filled_text(written, rows)


def _table_of_gaps(written: WrittenPattern, replies: Replies) -> str:
    asked = {one.number: one.value for one in written.pattern.questions}
    wide = written.pattern.bead.width_mm * ((written.mounted.swell_factor or 1.0) - 1.0)
    rows = []
    for number, gap in zip(replies.number.tolist(), replies.reply.tolist(), strict=True):
        row = [f"{number}", f"{asked[number]:g}"]
        if written.pattern.name == "comb":
            row.append(f"{max(asked[number] - wide, 0.0):.4f}")
        rows.append([*row, f"{gap:.4f}"])
    return filled_text(written, rows)
