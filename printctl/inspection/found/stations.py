"""Group sample points along lines into stations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.found.line_width import StationWidths
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.values import Stations, Unseen

_STATION_WIDTHS: Final = 0.6
"""Length of a station, in line widths."""
_MIN_SEEN_SHARE: Final = 0.5
"""Least share of seen places in a station that counts as seen."""


@dataclass(frozen=True)
class StationGrouping:
    """Assignment of sample points to stations.

    Attributes
    ----------
    of : (n,) int64
        Station of each place.
    first : (m,) int64
        A place in the middle of each station.
    count : (m,) int64
        Places of each.
    """

    of: IntArray
    first: IntArray
    count: IntArray

    @staticmethod
    def of_samples(samples: PathSamples) -> StationGrouping:
        """Group the sample points of each run."""
        size = np.maximum(1, np.rint(_STATION_WIDTHS * samples.width / samples.step)).astype(
            np.int64
        )
        start = np.flatnonzero(np.concatenate([[True], np.diff(samples.run) != 0]))
        length = np.diff(np.append(start, len(samples)))
        number = np.arange(len(samples)) - np.repeat(start, length)
        whole = np.repeat(size[start], length)
        groups = np.maximum(1, length // size[start])
        own = np.minimum(number // whole, np.repeat(groups, length) - 1)
        of = own + np.repeat(np.concatenate([[0], np.cumsum(groups)[:-1]]), length)
        count = np.bincount(of)
        return StationGrouping(of, np.cumsum(count) - count + count // 2, count)

    def mean(self, values: FloatArray, use: BoolArray) -> FloatArray:
        """Return the mean over the used places of each station, (m, ...); NaN for none."""
        number = np.bincount(self.of, weights=use, minlength=len(self.count))
        start = np.cumsum(self.count) - self.count
        shape = (-1,) + (1,) * (values.ndim - 1)
        total = np.add.reduceat(np.where(use.reshape(shape), values, 0.0), start, axis=0)
        return np.asarray(total / np.where(number > 0, number, np.nan).reshape(shape))

    def stations(
        self, samples: PathSamples, present: FloatArray, why: IntArray, widths: StationWidths
    ) -> Stations:
        """Build the stations' table of findings.

        Parameters
        ----------
        samples : PathSamples
            As designed.
        present : (n,) float64
            Share of ink at each place.
        why : (n,) int64
            `Unseen`.
        widths : StationWidths
            Of stations.
        """
        seen_places = why == Unseen.SEEN
        start = np.cumsum(self.count) - self.count
        share = np.add.reduceat(seen_places.astype(np.float64), start) / self.count
        seen = share >= _MIN_SEEN_SHARE
        ink = self.mean(np.clip(np.nan_to_num(present), 0.0, 1.0), seen_places)
        hide = np.where(seen, 1.0, np.nan)
        return Stations(
            at_mm=samples.point[self.first, :2],
            z_mm=samples.point[self.first, 2],
            normal=samples.normal[self.first],
            piece=samples.piece[self.first],
            stroke=samples.stroke[self.first],
            along_mm=self.mean(samples.along, np.ones(len(samples), dtype=np.bool_)),
            length_mm=self.count * samples.step[self.first],
            expected_mm=samples.width[self.first],
            width_mm=widths.width_mm * hide,
            u_width_mm=widths.u_mm * hide,
            offset_mm=widths.offset_mm * hide,
            present=np.where(seen, np.nan_to_num(ink), 0.0),
            seen=seen,
            why=np.where(seen, int(Unseen.SEEN), np.maximum.reduceat(why, start)).astype(np.int64),
            seam_share=widths.seam_share * hide,
        )
