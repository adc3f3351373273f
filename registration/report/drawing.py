"""A blank drawing in the report's style, and its SVG."""

from __future__ import annotations

import io
import warnings
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from registration.report.svg import INK, MUTED, PAPER, RULE

STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 9.2,
    # A vessel named "$x_2$" is a name, not a formula.
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "text.color": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "grid.color": RULE,
    "grid.linewidth": 0.7,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "savefig.facecolor": "none",
    "savefig.edgecolor": "none",
    "patch.edgecolor": PAPER,
}


def styled() -> Any:
    """Context in which a drawing is made and written; leaves the user's settings alone."""
    return rc_context(STYLE)


def blank(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """A drawing with one open pair of axes."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def to_svg(figure: Figure, salt: str) -> bytes:
    """The drawing as SVG; the same drawing gives the same bytes."""
    stream = io.BytesIO()
    with rc_context({"svg.hashsalt": salt}), warnings.catch_warnings():
        # The browser has its own fonts: a glyph missing here isn't missing there.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, dpi=150)
    return stream.getvalue()
