"""Waves of flow and pressure at a network's ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from registration.report.drawing import styled, to_svg
from registration.report.svg import ACCENT, INK, MUTED

FloatArray = NDArray[np.float64]


def wave_figure(waves: Mapping[str, FloatArray]) -> bytes:
    """Flow and pressure at inlet and outlet over one cycle.

    Parameters
    ----------
    waves : mapping
        ``time_s`` and, for inlet and outlet, ``…_flow_ml_min`` and ``…_pressure_mmhg``.

    Returns
    -------
    bytes
        SVG.
    """
    with styled():
        figure = Figure(figsize=(5.2, 4.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for axes, quantity, label in (
            (upper, "flow_ml_min", "flow / (mL/min)"),
            (lower, "pressure_mmhg", "pressure / mmHg"),
        ):
            _draw(axes, waves, quantity)
            axes.set_ylabel(label)
            axes.spines[["top", "right"]].set_visible(False)
        lower.set_xlabel("time / s")
        upper.legend(loc="upper right")
        return to_svg(figure, "waves")


def _draw(axes: Any, waves: Mapping[str, FloatArray], quantity: str) -> None:
    time = waves["time_s"]
    # The end repeats the begin.
    time = np.append(time, time[-1] + (time[1] - time[0]))
    for end, colour, style in (("inlet", ACCENT, "-"), ("outlet", INK, "--")):
        value = waves[f"{end}_{quantity}"]
        axes.plot(time, np.append(value, value[0]), style, color=colour, label=end)
    axes.axhline(0.0, color=MUTED, linewidth=0.5)
    axes.set_xlim(time[0], time[-1])
