"""Group points along lines into stations half a line width long; measure ink width at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.in_light import in_light, mixed_in_light
from registration.inspection.ink.ink_image import ACROSS
from registration.inspection.ink.presence import INK, Sides
from registration.inspection.ink.rims import has_rim
from registration.inspection.ink.told import Told
from registration.inspection.pictures.working import Working
from registration.inspection.values import FloatImage, Stations, Unseen
from registration.inspection.ways import Ways
from registration.inspection.widths.widths import Widths, measure_widths

_WIDTHS = 0.6
"""Of a line's width, to a station."""
_LEAST_SEEN = 0.5
_ROOM = 0.2
"""Of a width: bath that must be seen beside a line for its edge to be one."""
_PART = 0.7
"""Of a station, over bath with free sides, for its width to be told."""
_END = 0.6
_CODED = 2.2
"""Power of their values that is light, of pictures coded for screens."""
_MOST_SLANT = 0.6
"""Of light from the side, from which on edges are of the light, not of the ink."""


@dataclass(frozen=True)
class Grouping:
    """Which places make which station.

    Attributes
    ----------
    of : (n,) int64
        Station of each place.
    first : (m,) int64
        A place in the middle of each station.
    count, seen : (m,) int64
        Places, and of them seen.
    """

    of: IntArray
    first: IntArray
    count: IntArray
    seen: IntArray

    @staticmethod
    def of_ways(ways: Ways, seen: BoolArray) -> Grouping:
        """Group the places of each run."""
        size = np.maximum(1, np.rint(_WIDTHS * ways.width / ways.step)).astype(np.int64)
        begins = np.concatenate([[True], np.diff(ways.run) != 0])
        start = np.flatnonzero(begins)
        length = np.diff(np.append(start, len(ways)))
        number = np.arange(len(ways)) - np.repeat(start, length)
        whole = np.repeat(size[start], length)
        groups = np.maximum(1, length // size[start])
        own = np.minimum(number // whole, np.repeat(groups, length) - 1)
        offset = np.concatenate([[0], np.cumsum(groups)[:-1]])
        of = own + np.repeat(offset, length)
        count = np.bincount(of)
        first = np.cumsum(count) - count
        return Grouping(of, first + count // 2, count, np.bincount(of, weights=seen).astype(int))

    def mean(self, values: FloatArray | FloatImage, use: BoolArray) -> FloatArray:
        """Mean over the places of each station that are used, (m,) or (m, k); NaN for none."""
        number = np.bincount(self.of, weights=use, minlength=len(self.count))
        flat = values if values.ndim == 2 else values[:, None]
        start = np.cumsum(self.count) - self.count
        total = np.add.reduceat(np.where(use[:, None], flat, 0.0), start, axis=0)
        mean = total / np.where(number > 0, number, np.nan)[:, None]
        return mean if values.ndim == 2 else mean[:, 0]

    def stations(self, ways: Ways, present: FloatArray, why: IntArray, widths: Widths) -> Stations:
        """What was seen at each."""
        seen_places = why == Unseen.SEEN
        share = np.bincount(self.of, weights=seen_places, minlength=len(self.count)) / self.count
        seen = share >= _LEAST_SEEN
        reason = np.where(seen, int(Unseen.SEEN), self._worst(why))
        ink = self.mean(np.clip(np.nan_to_num(present), 0.0, 1.0), seen_places)
        hide = np.where(seen, 1.0, np.nan)
        return Stations(
            at_mm=ways.point[self.first, :2],
            z_mm=ways.point[self.first, 2],
            normal=ways.normal[self.first],
            piece=ways.piece[self.first],
            stroke=ways.stroke[self.first],
            along_mm=self.mean(ways.along, np.ones(len(ways), dtype=np.bool_)),
            length_mm=self.count * ways.step[self.first],
            expected_mm=ways.width[self.first],
            width_mm=widths.width_mm * hide,
            u_width_mm=widths.u_mm * hide,
            offset_mm=widths.offset_mm * hide,
            present=np.where(seen, ink, 0.0),
            seen=seen,
            why=reason.astype(np.int64),
        )

    def _worst(self, why: IntArray) -> IntArray:
        start = np.cumsum(self.count) - self.count
        return np.asarray(np.maximum.reduceat(why, start))


def station_widths(
    group: Grouping,
    ways: Ways,
    profiles: FloatImage,
    sides: Sides,
    bath: Told | None,
    over_old: BoolArray,
    present: FloatArray,
    seen: BoolArray,
    work: Working,
    part: float = _PART,
) -> Widths:
    """Widths where a line is seen over bath with free sides, for ``part`` of a station at least."""
    nothing = np.full(len(group.count), np.nan)
    if bath is None or bath.noise is None or bath.template.slant > _MOST_SLANT:
        return Widths(nothing, nothing, nothing, 0.0, 0.0)
    px_width = ways.width * work.px_per_mm
    room = 0.5 + _ROOM + 1.5 / px_width
    free = (sides.left > room) & (sides.right > room) & ~over_old
    ink = group.mean(np.nan_to_num(present), seen)
    use = seen & free & (ways.to_end > _END * ways.width)
    mean = group.mean(profiles, use)
    whole = group.mean(use.astype(np.float64), np.ones(len(ways), dtype=np.bool_)) > part
    tell = whole & (ink > INK * bath.noise.middle) & np.isfinite(mean).all(axis=1)
    left, right = sides.levels(profiles, px_width)
    left, right = (
        group.mean(left, use & np.isfinite(left)),
        group.mean(right, use & np.isfinite(right)),
    )
    # Where neighbours leave too little bath for a level of its own, that of all bath counts.
    left, right = np.nan_to_num(left), np.nan_to_num(right)
    tilt = 0.5 * (left + right)[:, None] + 0.5 * (left - right)[:, None] * np.clip(ACROSS, -1, 1)
    rimmed = work.is_scatter and has_rim(bath.template)  # no OCT sharpens its edges
    logs = np.where(tell[:, None], mean - tilt, 0.0)
    log_step = bath.scatter_step if rimmed else bath.log_step
    level = in_light(logs, log_step).astype(np.float32)
    return measure_widths(
        level,
        ways.width[group.first],
        ways.stroke[group.first],
        tell,
        bath.template,
        1.0 / work.px_per_mm,
        _noise(level, tell, sides, group),
        work.is_log,
        work.flanks_lost,
        rimmed,
        _otherwise(logs, bath) if work.is_log else None,
        work.is_log and bath.log_step > 0.0,
    )


def _otherwise(logs: FloatArray | FloatImage, bath: Told) -> FloatImage | None:
    """Levels in light if the picture is coded for screens, by all channels; None for no light."""
    look = bath.appearance
    whole = float(look.mix @ bath.ink)
    if bath.log_step == 0.0 or whole == 0.0:
        return None
    values = logs * (bath.template.scale / whole)
    light = mixed_in_light(values, look.mix, bath.ink, _CODED)
    return None if light is None else light.astype(np.float32)


def _noise(level: FloatImage, tell: BoolArray, sides: Sides, group: Grouping) -> float:
    """Scatter of a single value of a station's profile: of the bath beside lines, and of ink."""
    if tell.sum() < 8:
        return 0.0
    middle = level[tell][:, np.abs(ACROSS) < 0.3]
    ink = _spread(middle - np.median(middle, axis=0))
    clear = np.minimum(sides.left, sides.right)[group.first][tell]
    zone = (np.abs(ACROSS) > 0.8) & (np.abs(ACROSS) < 1.1)
    bath = level[tell][clear > 1.2][:, zone]
    beside = _spread(bath - np.median(bath, axis=0)) if len(bath) > 8 else ink
    return float(np.sqrt(0.5 * (ink**2 + beside**2)))


def _spread(values: FloatArray | FloatImage) -> float:
    return 1.4826 * float(np.median(np.abs(values)))
