"""Travels between written paths: linked, level, or lifted over an open lumen."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from design.toolpath.fresh.options import FreshOptions
from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import FloatArray


class Traveller:
    """Moves the needle to the next path, and counts how.

    Attributes
    ----------
    builder : MoveBuilder
        Where the moves go.
    travels, lifted, links : int
        As in `FreshReport`.
    """

    def __init__(self, builder: MoveBuilder, options: FreshOptions) -> None:
        self.builder = builder
        self.travels = self.lifted = self.links = 0
        self._options = options
        self._layer = -1
        self._open: list[shapely.MultiLineString] = []

    def enter(self, layer: int, boundary: shapely.MultiLineString) -> None:
        """Go on with ``layer``; its contours and those of the layer below are obstacles.

        Between two layers the needle travels at the height of the upper one, with its tip on
        the lower: it must cross the lumens of neither.
        """
        self._layer = layer
        self._open = [*self._open[-1:], boundary]

    def crosses(self, travels: NDArray[np.object_]) -> NDArray[np.bool_]:
        """Which of these level travels would leave the material of this layer.

        The first one comes from the layer below and is held against that layer too.
        """
        crossing: NDArray[np.bool_] = shapely.intersects(self._open[-1], travels)
        crossing[0] |= shapely.intersects(self._open[0], travels[0])
        return crossing

    def go(self, to: FloatArray, crossing: bool) -> None:
        """Bring the tip to ``to`` (3,); nothing to do when it is there."""
        tip = self.builder.tip
        hop = float(np.linalg.norm(to - tip))
        if hop == 0:
            return
        self.travels += 1
        if not crossing and hop <= self._options.link_mm and to[2] == tip[2]:
            self.links += 1
            self.builder.travel(to[None], self._options.travel_speed_mm_s, self._layer)
            return
        self._plunge(-self._options.retract_ul)
        if crossing:
            self.lifted += 1
        self._fly(to, self._options.lift_mm if crossing else 0.0)
        self._plunge(self._options.retract_ul)

    def _fly(self, to: FloatArray, lift_mm: float) -> None:
        tip, top = self.builder.tip, max(self.builder.tip[2], to[2]) + lift_mm
        level = [np.array([*tip[:2], top]), np.array([*to[:2], top]), to]
        speeds = (
            self._options.lift_speed_mm_s,
            self._options.travel_speed_mm_s,
            self._options.lift_speed_mm_s,
        )
        for point, speed in zip(level, speeds, strict=True):
            if np.any(point != self.builder.tip):
                self.builder.travel(point[None], speed, self._layer)

    def _plunge(self, volume_ul: float) -> None:
        self.builder.plunge(volume_ul, self._options.plunger_ul_s, self._layer)
