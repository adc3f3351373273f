"""Draw expected lines, measured edges, gaps and unseen parts over a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from printctl.inspection.findings import LayerFindings
from printctl.inspection.inputs import (
    check_frame,
    check_lumens,
    check_picture,
    check_type,
)
from printctl.inspection.pictures.picture import SUBPIXEL_BITS
from printctl.inspection.values import Frame, Image, Lumen, Stations, Unseen

# Blue, green, red.
_EXPECTED_BGR: Final = (230, 170, 60)
_SEEN_BGR: Final = (60, 200, 40)
_GAP_BGR: Final = (30, 30, 235)
_UNSEEN_BGR: Final = (0, 215, 255)
_BLOB_BGR: Final = (220, 40, 220)
_THIN_BGR: Final = (0, 130, 255)
_MIN_SIDE_PX: Final = 1400
"""Pictures whose longer side is below this are enlarged."""
_MIN_MARGIN_PX: Final = 40.0
"""Least margin around the lines."""
_LEGEND: Final = (
    ("expected", _EXPECTED_BGR),
    ("seen", _SEEN_BGR),
    ("gap, lumen narrowed", _GAP_BGR),
    ("not seen", _UNSEEN_BGR),
    ("thin or thick", _THIN_BGR),
    ("ink where none should be", _BLOB_BGR),
)


def annotated(
    picture: Image, frame: Frame, findings: LayerFindings, narrowed: Sequence[Lumen] = ()
) -> NDArray[np.uint8]:
    """Return the picture (rows, columns, 3), blue-green-red, with findings drawn in.

    A view more than twice as large as the lines and their margin is cropped to these: a part of
    8 mm in a view of 90 mm is too small to judge a gap in.
    Outlines of the expected lines; edges as seen; gaps and the outlines of ``narrowed`` lumens red;
    hatched what wasn't seen; thin and thick stretches orange; blobs magenta. Small pictures are
    enlarged; one of two channels is drawn
    by its first.

    Raises
    ------
    PictureError
        When an argument can't be used.
    """
    check_type(findings, LayerFindings, "findings")
    check_picture(picture, "the picture")
    check_lumens(narrowed, "narrowed")
    stations = findings.stations
    check_frame(frame, np.column_stack([stations.at_mm, stations.z_mm]))
    picture, frame = _around_lines(picture, frame, stations)
    grow = max(1, -(-_MIN_SIDE_PX // max(picture.shape[:2])))
    out = _as_bytes(picture)
    out = cv2.resize(out, None, fx=grow, fy=grow, interpolation=cv2.INTER_LINEAR)
    pen = _Pen(out, frame, grow, max(1, round(max(out.shape) / 1600)))
    by = np.array([findings.shift.dx_mm, findings.shift.dy_mm])
    _draw_expected(pen, stations)
    _draw_seen(pen, stations, by)
    _draw_unseen(pen, stations, by)
    for stretch in findings.stretches:
        rows = _along(stations, stretch.stroke, stretch.from_mm, stretch.to_mm)
        pen.path(stations.at_mm[rows] + by, stations.z_mm[rows], _THIN_BGR, 2)
    for gap in findings.gaps:
        rows = _along(stations, gap.stroke, gap.from_mm, gap.to_mm)
        inner = stations.at_mm[rows[1:-1]] if len(rows) > 2 else np.empty((0, 2))
        places = np.vstack([gap.start_mm, inner, gap.end_mm])
        nearest = rows[:1] if len(rows) else np.flatnonzero(stations.stroke == gap.stroke)[:1]
        pen.path(places, np.full(len(places), float(stations.z_mm[nearest[0]])), _GAP_BGR, 4)
    for lumen in narrowed:
        closed = np.vstack([lumen.outline, lumen.outline[:1]])
        pen.path(closed[:, :2] + by, closed[:, 2], _GAP_BGR, 4)
    z = float(np.median(stations.z_mm))
    for blob in findings.blobs:
        closed = np.vstack([blob.outline_mm, blob.outline_mm[:1]])
        pen.path(closed, np.full(len(closed), z), _BLOB_BGR, 2)
    _legend(out, findings)
    return out


@dataclass(frozen=True)
class _Cut:
    """Frame of a crop that begins at a pixel (x, y) of a picture."""

    whole: Frame
    begin_px: tuple[int, int]

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of places (n, 3), mm."""
        return self.whole.to_pixels(points_mm) - np.array(self.begin_px, dtype=np.float64)


def _around_lines(picture: Image, frame: Frame, stations: Stations) -> tuple[Image, Frame]:
    """Crop to the lines and a margin of half of their extent."""
    seen = frame.to_pixels(np.column_stack([stations.at_mm, stations.z_mm]))
    seen = seen[np.isfinite(seen).all(axis=1)]
    if not len(seen):
        return picture, frame
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = max(_MIN_MARGIN_PX, float((high - low).max()) / 2)
    size = np.array(picture.shape[1::-1])
    begin = np.clip(np.floor(low - margin), 0, size).astype(int)
    end = np.clip(np.ceil(high + margin), 0, size).astype(int)
    if (end - begin < 2).any() or (end - begin > size / 2).any():  # out of the view, or filling it
        return picture, frame
    x, y = int(begin[0]), int(begin[1])
    return picture[y : end[1], x : end[0]], _Cut(frame, (x, y))


class _Pen:
    """Pen that draws at printer coordinates into a picture."""

    def __init__(self, out: NDArray[np.uint8], frame: Frame, grow: int, thick: int) -> None:
        self.out, self.frame, self.grow, self.thick = out, frame, grow, thick

    def pixels(self, xy_mm: FloatArray, z_mm: FloatArray) -> NDArray[np.int32]:
        """Return fixed-point pixels (n, 2) for OpenCV."""
        seen = self.frame.to_pixels(np.column_stack([xy_mm, z_mm]))
        placed = (np.nan_to_num(seen, nan=-1e4) + 0.5) * self.grow - 0.5
        return np.rint(np.clip(placed, -1e5, 1e5) * (1 << SUBPIXEL_BITS)).astype(np.int32)

    def path(
        self, xy_mm: FloatArray, z_mm: FloatArray, colour: tuple[int, int, int], times: int = 1
    ) -> None:
        """Draw one line through all places."""
        if len(xy_mm) < 2:
            return
        cv2.polylines(
            self.out, [self.pixels(xy_mm, z_mm)], False, colour, self.thick * times, cv2.LINE_AA,
            SUBPIXEL_BITS,
        )  # fmt: skip

    def pieces(
        self,
        begin_mm: FloatArray,
        end_mm: FloatArray,
        z_mm: FloatArray,
        colour: tuple[int, int, int],
        times: int = 1,
    ) -> None:
        """Draw one straight line for each row."""
        if len(begin_mm):
            both = np.stack([self.pixels(begin_mm, z_mm), self.pixels(end_mm, z_mm)], axis=1)
            cv2.polylines(
                self.out, list(both), False, colour, self.thick * times, cv2.LINE_AA, SUBPIXEL_BITS
            )


def _draw_expected(pen: _Pen, s: Stations) -> None:
    """Draw both edges of the expected lines, without the shift."""
    ahead = np.column_stack([s.normal[:, 1], -s.normal[:, 0]])
    half = 0.5 * s.length_mm[:, None] * ahead
    for side in (-0.5, 0.5):
        edge = s.at_mm + side * s.expected_mm[:, None] * s.normal
        pen.pieces(edge - half, edge + half, s.z_mm, _EXPECTED_BGR)


def _draw_seen(pen: _Pen, s: Stations, by: FloatArray) -> None:
    """Draw measured edges from station to station; the middle where no width is known."""
    measured = np.isfinite(s.width_mm)
    middle = s.at_mm + by + np.nan_to_num(s.offset_mm)[:, None] * s.normal
    pair = measured[1:] & measured[:-1] & (s.stroke[1:] == s.stroke[:-1])
    pair &= s.along_mm[1:] - s.along_mm[:-1] < 2.5 * s.length_mm[1:]
    for side in (-0.5, 0.5):
        edge = middle + side * np.nan_to_num(s.width_mm)[:, None] * s.normal
        pen.pieces(edge[:-1][pair], edge[1:][pair], s.z_mm[1:][pair], _SEEN_BGR)
    alone = s.seen & ~measured & (s.present > 0.5)
    ahead = np.column_stack([s.normal[:, 1], -s.normal[:, 0]]) * 0.3 * s.length_mm[:, None]
    pen.pieces((middle - ahead)[alone], (middle + ahead)[alone], s.z_mm[alone], _SEEN_BGR)


def _draw_unseen(pen: _Pen, s: Stations, by: FloatArray) -> None:
    """Hatch stations that weren't seen, except outside the picture."""
    rows = ~s.seen & (s.why != Unseen.OUTSIDE)
    slant = s.normal + np.column_stack([s.normal[:, 1], -s.normal[:, 0]])
    half = 0.35 * s.expected_mm[:, None] * slant
    place = s.at_mm + by
    pen.pieces((place - half)[rows], (place + half)[rows], s.z_mm[rows], _UNSEEN_BGR)


def _along(s: Stations, stroke: int, begin: float, end: float) -> NDArray[np.int64]:
    half = 0.5 * s.length_mm
    return np.flatnonzero(
        (s.stroke == stroke) & (s.along_mm + half > begin) & (s.along_mm - half < end)
    )


def _as_bytes(picture: Image) -> NDArray[np.uint8]:
    values = picture if picture.ndim == 3 else picture[:, :, None]
    values = values[:, :, :3] if values.shape[2] >= 3 else values[:, :, :1]
    if values.dtype != np.uint8:
        real = values.astype(np.float32)
        known = real[np.isfinite(real)]
        low, high = np.percentile(known, [0.5, 99.5]) if len(known) else (0.0, 0.0)
        scaled = (real - low) / max(float(high - low), 1e-9) * 255.0
        values = np.clip(np.nan_to_num(scaled), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(values, (*values.shape[:2], 3)))


def _legend(out: NDArray[np.uint8], findings: LayerFindings) -> None:
    """Draw colours and the main figures in the upper left corner."""
    size = max(out.shape[:2]) / 2400
    row = round(42 * size)
    ratio = findings.width_ratio
    width = (
        "width unknown"
        if np.isnan(ratio)
        else (f"width {100 * ratio:.0f} +- {200 * findings.u_width_ratio:.0f} %")
    )
    count = len(findings.gaps)
    lines = [
        f"seen {100 * findings.seen_share:.0f} %, {width}, {count} gap{'s' * (count != 1)}, shift "
        f"{1e3 * findings.shift.dx_mm:.0f}, {1e3 * findings.shift.dy_mm:.0f} um",
        *(name for name, _ in _LEGEND),
    ]
    colours = [(255, 255, 255), *(colour for _, colour in _LEGEND)]
    for k, (line, colour) in enumerate(zip(lines, colours, strict=True)):
        at = (round(16 * size), row * (k + 1))
        for shade, thick in (((0, 0, 0), round(6 * size) + 1), (colour, round(2 * size) + 1)):
            cv2.putText(out, line, at, cv2.FONT_HERSHEY_SIMPLEX, size, shade, thick, cv2.LINE_AA)
