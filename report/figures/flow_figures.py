"""SVG figures of vessel flow: pressure and flow waves, model fidelities, spread of flows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from kernels.arrays import FloatArray
from report.drawing import styled, to_svg
from report.svg import ACCENT, INK, MUTED


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


def comparison_figure(line: Mapping[str, Any]) -> bytes:
    """Flow and pressure of several fidelities along a vessel and, in pulses, over a cycle.

    Parameters
    ----------
    line : mapping
        ``vessel``, ``time_s`` (t,), ``fraction`` (p,), and ``flow_ml_min`` and ``pressure_mmhg``,
        each a mapping of fidelity to (p, t).

    Returns
    -------
    bytes
        SVG.
    """
    pulse = len(line["time_s"]) > 1
    with styled():
        figure = Figure(figsize=(8.4 if pulse else 5.2, 4.6), layout="constrained")
        grid = figure.subplots(2, 1 + pulse, squeeze=False)
        for row, quantity, label in (
            (grid[0], "flow_ml_min", "flow / (mL/min)"),
            (grid[1], "pressure_mmhg", "pressure / mmHg"),
        ):
            _draw_along(row[0], line, quantity)
            row[0].set_ylabel(label)
            if pulse:
                _draw_over_cycle(row[1], line, quantity)
            for axes in row:
                axes.spines[["top", "right"]].set_visible(False)
        grid[1, 0].set_xlabel(f"share of the way along vessel {line['vessel']}")
        if pulse:
            grid[1, 1].set_xlabel("time / s")
            grid[0, 0].set_title("mean of a cycle")
            grid[0, 1].set_title("amid the vessel")
        _widen_flat(grid[0, 0])
        grid[0, 0].legend(loc="best")
        return to_svg(figure, "comparison")


_STYLES = (
    {"color": MUTED, "linestyle": "-", "linewidth": 3.0},
    {"color": ACCENT, "linestyle": "-", "linewidth": 1.2},
    {"color": INK, "linestyle": "--", "linewidth": 1.2},
)


def _draw_along(axes: Any, line: Mapping[str, Any], quantity: str) -> None:
    for (name, values), style in zip(line[quantity].items(), _STYLES, strict=False):
        mark = "o" if name == "3D" else None
        axes.plot(line["fraction"], values.mean(axis=1), marker=mark, label=name, **style)
    axes.set_xlim(0.0, 1.0)


def _draw_over_cycle(axes: Any, line: Mapping[str, Any], quantity: str) -> None:
    time = line["time_s"]
    whole = np.append(time, time[-1] + (time[1] - time[0]))
    for values, style in zip(line[quantity].values(), _STYLES, strict=False):
        middle = values[len(values) // 2]
        axes.plot(whole, np.append(middle, middle[0]), **style)
    axes.set_xlim(whole[0], whole[-1])


def _widen_flat(axes: Any) -> None:
    """Flow along a vessel is one number: let its digits of noise not fill the picture."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low), 0.1 * abs(middle))
    axes.set_ylim(middle - half, middle + half)


def spread_figure(flows: Mapping[str, FloatArray]) -> bytes:
    """Share of feeding vessels up to each flow, flows over their mean; a step up is ideal.

    Returns
    -------
    bytes
        SVG.
    """
    with styled():
        figure = Figure(figsize=(5.2, 3.2), layout="constrained")
        axes = figure.subplots()
        for (name, flow), colour in zip(flows.items(), (ACCENT, MUTED), strict=False):
            ordered = np.sort(flow)
            share = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
            axes.step(np.append(ordered, ordered[-1]), np.append(0.0, share), where="post",
                      color=colour, label=f"{name} ({len(ordered)} vessels)")  # fmt: skip
        axes.axvline(1.0, color=INK, linewidth=0.6, linestyle=":")
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 102.0)
        axes.set_xlabel("flow over the mean")
        axes.set_ylabel("vessels with no more / %")
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="lower right")
        return to_svg(figure, "spread")
