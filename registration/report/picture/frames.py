"""Draw a network film's frames: same camera and colours, caption, curve of the driving pulse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.report.picture.compose import (
    FINER,
    STYLE,
    PictureOptions,
    annotated,
    dots_per_inch,
    rendered,
    scene_camera,
)
from registration.report.picture.quantity import Quantity
from registration.report.picture.render import shade

Frame = NDArray[np.uint8]

_STRIP = 0.16
"""Height of the wave's strip over the film's width."""


@dataclass(frozen=True, eq=False)
class DrivingWave:
    """A value over a cycle, drawn below the scene with a mark at the frame's time.

    Attributes
    ----------
    time_s, value : (t,) float64
        The cycle's end left out.
    title : str
        Name and unit of the value.
    period_s : float, s
    """

    time_s: FloatArray
    value: FloatArray
    title: str
    period_s: float


@dataclass(frozen=True, eq=False)
class FilmScene:
    """What all frames share: the whole network, which sets the camera, and the tissue."""

    whole: VesselNetwork
    surface: Surface | None
    options: PictureOptions

    def frame(self, network: VesselNetwork, quantity: Quantity, caption: str) -> Frame:
        """Draw what there is of the network; (height, width, 3), red, green, blue."""
        camera = scene_camera(self.whole, self.surface, self.options)
        image, _ = shade(network, quantity, self.surface, camera, FINER)

        def mark(figure: Figure) -> None:
            figure.text(0.03, 0.985, caption, ha="left", va="top", fontsize=10.0)

        drawn = annotated(image, quantity, camera, self.options.width, mark)
        return _even(np.asarray(drawn))

    def strip(self, wave: DrivingWave, time_s: float) -> Frame:
        """Draw the wave that drives the network, and where in it a time is."""
        width = self.options.width
        dpi, height = dots_per_inch(width), 2 * round(0.5 * _STRIP * width)
        with rc_context(STYLE):
            figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
            axes = figure.add_axes((0.12, 0.36, 0.70, 0.56))
            closed = np.append(wave.time_s, wave.period_s), np.append(wave.value, wave.value[0])
            axes.plot(*closed, color="#5f6972", linewidth=1.0)
            now = float(np.interp(time_s, *closed))
            axes.plot([time_s], [now], "o", color="#d55e00", markersize=4.5)
            axes.set(xlim=(0.0, wave.period_s), xlabel="Time / s")
            axes.set_ylabel(wave.title.replace(" / ", "\n/ "), fontsize=7.5)
            axes.spines[["top", "right"]].set_visible(False)
            return _even(np.asarray(rendered(figure)))


def _even(image: Frame) -> Frame:
    """Without a last row or column of an odd size, which film formats can't hold."""
    return np.ascontiguousarray(image[: len(image) // 2 * 2, : image.shape[1] // 2 * 2])
