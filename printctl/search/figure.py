"""Pareto plot of a design search: each pair of goals, with the non-dominated candidates."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import combinations
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate, round_to_grain
from printctl.search.run import SearchResult
from report.drawing import styled, to_svg
from report.svg import ACCENT, MUTED

PANEL_IN: Final = (4.4, 3.5)
LEAST_IN: Final = 5.6
"""Room for the legend."""
MOST_GOALS: Final = 4
"""Every pair of them is drawn: six panels."""
DPI: Final = 130
BEST: Final = "#b0578d"
FAINT: Final = "#a9b1b8"


def pareto_png(result: SearchResult) -> bytes:
    """The plot as PNG; the same results give the same bytes."""
    with styled():
        stream = io.BytesIO()
        figure = _figure(result)
        figure.set_facecolor("white")
        FigureCanvasAgg(figure).print_figure(
            stream, dpi=DPI, format="png", facecolor="white", metadata={"Software": None}
        )
    return stream.getvalue()


def pareto_svg(result: SearchResult) -> bytes:
    """The plot as SVG, for the page."""
    with styled():
        return to_svg(_figure(result), "pareto")


def _figure(result: SearchResult) -> Figure:
    pairs = _pairs(result)
    columns = min(len(pairs), 3)
    rows = -(-len(pairs) // columns)
    size = (max(PANEL_IN[0] * columns, LEAST_IN), PANEL_IN[1] * rows + 0.4)
    figure = Figure(figsize=size, layout="constrained")
    every = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in every[len(pairs) :]:
        axes.set_axis_off()
    for axes, (across, up) in zip(every, pairs, strict=False):
        _draw(axes, result, across, up)
    handles, labels = every[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), columnspacing=1.0)
    return figure


def _pairs(result: SearchResult) -> list[tuple[str, str]]:
    """Goals two by two; a single one against what is varied first."""
    goals = list(result.drawn.search.goals)[:MOST_GOALS]
    if len(goals) > 1:
        return list(combinations(goals, 2))
    return [(next(iter(result.drawn.search.vary)), goals[0])]


def _draw(axes: Axes, result: SearchResult, across: str, up: str) -> None:
    measured = [row for row in result.rows if row.state in ("good", "beyond limits")]
    front = [row for row in measured if row.front == 1]
    other = [row for row in measured if row.state == "good" and row.front != 1]
    beyond = [row for row in measured if row.state == "beyond limits"]
    _dots(axes, beyond, across, up, "beyond a limit", marker="x", color=FAINT, s=20, lw=1.1)
    _dots(axes, other, across, up, "beaten by another", color=MUTED, s=16, alpha=0.75, lw=0)
    _dots(axes, front, across, up, "Pareto front", color=ACCENT, s=26, lw=0, zorder=3)
    if result.best is not None:
        _dots(
            axes, [result.best], across, up, "best score", marker="*", s=150, zorder=4,
            facecolor="none", edgecolor=BEST, lw=1.4,
        )  # fmt: skip
    if len(result.drawn.search.goals) == 2:
        _stairs(axes, result, front, across, up)
    axes.set_xlabel(_title(across, result))
    axes.set_ylabel(_title(up, result))
    axes.grid(True)
    axes.spines[["top", "right"]].set_visible(False)


def _dots(
    axes: Axes, rows: Sequence[RankedCandidate], across: str, up: str, label: str, **style: Any
) -> None:
    points = np.array([[_at(row, across), _at(row, up)] for row in rows]).reshape(-1, 2)
    axes.scatter(points[:, 0], points[:, 1], label=label, **style)


def _at(row: RankedCandidate, name: str) -> float:
    if name in QUANTITIES:
        value = row.numbers.get(name)
        return np.nan if value is None else round_to_grain(name, row.numbers)
    varied = row.candidate.values[name]
    return float(varied) if isinstance(varied, int | float) else np.nan


def _stairs(
    axes: Axes, result: SearchResult, front: Sequence[RankedCandidate], across: str, up: str
) -> None:
    """The edge of what was reached: nothing that was found lies on its good side."""
    goals = result.drawn.search.goals
    points = sorted((_at(row, across), _at(row, up)) for row in front)
    if len(points) > 1:
        where: Literal["post", "pre"] = "post" if goals[across].goal == "minimise" else "pre"
        x, y = zip(*points, strict=True)
        axes.step(x, y, where=where, color=ACCENT, lw=0.9, alpha=0.6, zorder=2)


def _title(name: str, result: SearchResult) -> str:
    if name not in QUANTITIES:
        return name
    goal = result.drawn.search.objectives[name].goal
    better = {"minimise": "less is better", "maximise": "more is better"}.get(goal or "", "")
    return f"{QUANTITIES[name].title} ({better})"
