"""Data class of a surface in the report's 3D view: mesh, vertex values, colour limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from report.errors import ReportError


@dataclass(frozen=True, eq=False)
class ReportSurface:
    """A surface with a name and, perhaps, a number at each vertex.

    Attributes
    ----------
    name : str
        Shown to the reader, as text.
    surface : Surface
        All of one report share one frame, the part's.
    scalar : (n,) float or None
        Coloured where it is finite, grey where it is NaN. A surface without one is shown
        translucent, as the setting of the others.
    unit : str
        Of `scalar`.
    limits : (float, float) or None
        Ends of the colour bar, in `unit`; None takes the 99th percentile, symmetric about zero
        where the scalar changes sign. Limits on both sides of zero choose the diverging colours.

    Raises
    ------
    ReportError
        When shapes disagree, a position isn't finite, or a face names a missing vertex.
    """

    name: str
    surface: Surface
    scalar: NDArray[np.floating[Any]] | None = None
    unit: str = ""
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self._check_mesh()
        self._check_scalar()

    def _check_mesh(self) -> None:
        where = f"report surface {self.name!r}"
        vertices, faces = self.surface.vertices, self.surface.faces
        for title, array in (("vertices", vertices), ("faces", faces)):
            if array.ndim != 2 or array.shape[1] != 3:
                raise ReportError(f"{where}: {title} have shape {array.shape}, not (n, 3)")
        if len(faces) == 0:
            raise ReportError(f"{where} has no faces; leave it out of the report")
        if not np.isfinite(vertices).all():
            raise ReportError(f"{where}: a position is NaN or infinite; mend the mesh")
        low, high = int(faces.min()), int(faces.max())
        if low < 0 or high >= len(vertices):
            raise ReportError(
                f"{where}: faces name vertices {low} to {high}, but there are "
                f"{len(vertices)}; mend the mesh"
            )

    def _check_scalar(self) -> None:
        count = len(self.surface.vertices)
        if self.scalar is not None and self.scalar.shape != (count,):
            raise ReportError(
                f"report surface {self.name!r}: scalar has shape {self.scalar.shape}, "
                f"one number per vertex ({count}) is needed"
            )
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise ReportError(
                f"report surface {self.name!r}: limits {self.limits} {self.unit} aren't ascending"
            )

    def colour_limits(self) -> tuple[float, float]:
        """Ends of the colour bar, in `unit`; (0, 1) where there is nothing to colour."""
        if self.limits is not None:
            return self.limits
        if self.scalar is None:
            return (0.0, 1.0)
        return robust_limits(self.scalar)

    def extremes(self) -> tuple[float, float]:
        """Least and greatest value, in `unit`; the limits where there is none."""
        if self.scalar is None or not np.isfinite(self.scalar).any():
            return self.colour_limits()
        return float(np.nanmin(self.scalar)), float(np.nanmax(self.scalar))


def robust_limits(values: NDArray[np.floating[Any]]) -> tuple[float, float]:
    """Colour limits that leave out the last percent, symmetric where the sign changes.

    Parameters
    ----------
    values : (n,) float
        NaN is left out.

    Returns
    -------
    (float, float)
        Ascending, or equal for a constant; (0, 1) when no value is finite.
    """
    finite = np.asarray(values, dtype=np.float64)[np.isfinite(values)]
    if len(finite) == 0:
        return (0.0, 1.0)
    low, high = (float(v) for v in np.percentile(finite, [1.0, 99.0]))
    if finite.min() < 0.0 < finite.max():
        reach = max(-low, high, 1e-9)
        return (-reach, reach)
    return (low, high)
