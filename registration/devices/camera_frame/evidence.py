"""Data classes for fitting a camera's pose: touched crosses, printed points, insert's place."""

from __future__ import annotations

from dataclasses import dataclass

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Touch:
    """A cross of the insert that the needle's tip touched.

    Attributes
    ----------
    name : str
        Of the cross.
    x_mm, y_mm : float, mm
        The printer's position with the tip on the cross.
    z_mm : float, mm, or None
        With the tip on the plate; None where it wasn't lowered that far.
    u_mm : float, mm
        Standard uncertainty of each.
    """

    name: str
    x_mm: float
    y_mm: float
    z_mm: float | None = None
    u_mm: float = 0.05


@dataclass(frozen=True, eq=False)
class PrintedPoints:
    """Places that the printer itself drew, as a picture shows them.

    Attributes
    ----------
    places_mm : (n, 3) float64, mm
        By the G-code, printer's frame.
    pixels : (n, 2) float64
    u_mm : (n,) float64, mm
        Standard uncertainty of each along each axis: how well ink lies where the motors went, and
        is measured in the picture.
    common_u_mm : float, mm
        Of what all of them share: the drawing as a whole against the printer's axes.
    """

    places_mm: FloatArray
    pixels: FloatArray
    u_mm: FloatArray
    common_u_mm: float = 0.0


@dataclass(frozen=True)
class Placement:
    """Where the insert lies, as far as it is known beforehand.

    Attributes
    ----------
    origin_mm : (x, y, z), mm
        Of the insert's middle, at the marks' height; printer's frame.
    turned_rad : float
        Of the insert about z, anticlockwise from above.
    u_xy_mm, u_z_mm, u_turned_rad : float
        Standard uncertainties; 0 where these numbers define the frame.
    u_tilt_rad : float
        Of the plate against the printer's plane, about each axis.
    """

    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turned_rad: float = 0.0
    u_xy_mm: float = 0.0
    u_z_mm: float = 0.0
    u_turned_rad: float = 0.0
    u_tilt_rad: float = 0.0
