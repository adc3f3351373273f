"""Short `repr`, HTML, table and plot of values that hold arrays, for notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, ClassVar

import numpy as np

from design.errors import DesignError
from kernels.arrays import FloatArray


class NotebookView:
    """Part of a dataclass (``repr=False``) that shows itself by what it is made of.

    A class says its facts, its columns and how it is drawn; ``projection`` is its axes'.
    """

    projection: ClassVar[str | None] = None

    def __repr__(self) -> str:
        facts = ", ".join(f"{name}: {value}" for name, value in self._facts().items())
        return f"<{type(self).__name__} {facts}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self._facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"

    def to_pandas(self) -> Any:
        """Return a table (`pandas.DataFrame`), its columns named with their units.

        Raises
        ------
        DesignError
            Where pandas isn't installed.
        """
        try:
            import pandas as pd  # no dependency of ours
        except ImportError as exc:
            raise DesignError(
                "a table needs pandas, which isn't installed; pip install pandas"
            ) from exc
        return pd.DataFrame(dict(self._columns()))

    def plot(self, axes: Any = None) -> Any:
        """Draw on matplotlib's axes, or on new ones; return them."""
        if axes is None:
            from matplotlib import pyplot as plt  # heavy

            axes = plt.figure().add_subplot(projection=self.projection)
        self._draw(axes)
        return axes

    def _facts(self) -> Mapping[str, str]:
        """Names and values, a few."""
        raise NotImplementedError

    def _columns(self) -> Mapping[str, Sequence[Any] | np.ndarray]:
        """Columns of equal length."""
        raise NotImplementedError

    def _draw(self, axes: Any) -> None:
        raise NotImplementedError


def draw_lines(axes: Any, lines: FloatArray, value: FloatArray, label: str) -> None:
    """Draw pieces (n, 2, 3), mm, in 3D, coloured by a value each (n,) with a bar beside."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # heavy

    drawn = Line3DCollection(list(lines), array=value)
    axes.add_collection3d(drawn)
    low, high = lines.reshape(-1, 3).min(axis=0), lines.reshape(-1, 3).max(axis=0)
    for k, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(low[k], high[k] if high[k] > low[k] else low[k] + 1.0)
        getattr(axes, f"set_{name}label")(f"{name} (mm)")
    axes.set_box_aspect(np.maximum(high - low, 1e-3 * max(1e-9, (high - low).max())))
    axes.figure.colorbar(drawn, ax=axes, label=label)


def span(values: FloatArray, unit: str) -> str:
    """Lowest and highest of values, with their unit; "none" for none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return "none"
    return f"{known.min():.4g} to {known.max():.4g} {unit}"
