"""Dish insert: a flat plate around a dish with ArUco marks and crosses at known places."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from firmware_profiles.plates import Dish
from kernels.arrays import FloatArray
from registration.devices.lens.model_file import read_model
from registration.errors import PictureError

Process = Literal["fdm", "resin", "paper", "engraved"]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

DICTIONARY: Final = "4X4_50"
CELLS: Final = 6
"""Of a mark's side, its black border included."""
FEWEST_MARKS: Final = 8
_MOST_MARKS: Final = 50
_CROSS_ARM: Final = 0.35
"""Length of a cross' arm, of a mark's side."""
_MOST_MM: Final = 400.0


class Tolerance(NamedTuple):
    """Standard uncertainties of a way of making.

    Attributes
    ----------
    scale : float
        As a share.
    mark_mm : float, mm
        Of a single mark's place.
    square : float
        Of the scale along y against that along x, and of the angle between them, rad.
    bent_mm : float, mm
        By which the plate bends up or down towards its edge.
    """

    scale: float
    mark_mm: float
    square: float
    bent_mm: float


TOLERANCES: Final[dict[Process, Tolerance]] = {
    "fdm": Tolerance(2e-3, 0.04, 1e-3, 0.2),
    "resin": Tolerance(2e-3, 0.02, 1e-3, 0.2),
    "paper": Tolerance(1.5e-3, 0.02, 1.5e-3, 0.2),
    "engraved": Tolerance(3e-4, 0.01, 3e-4, 0.15),
}
"""Before measuring: filament shrinks by 0.2 to 0.7 %, office printers feed by 0.1 to 0.3 % more or
less and not alike both ways, engravers are good to some 10 µm; plates warp. Our estimates;
measuring over the crosses replaces the first."""


class Mark(BaseModel):
    """A mark's number in the dictionary, and its middle on the insert, mm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    number: Annotated[int, Field(ge=0, lt=_MOST_MARKS)]
    x_mm: Number
    y_mm: Number


class Cross(BaseModel):
    """A cross to touch with the needle's tip: its name, and its middle on the insert, mm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    x_mm: Number
    y_mm: Number


class Insert(BaseModel):
    """An insert; its frame has the dish's middle as origin, x to the right, y away, z up.

    Attributes
    ----------
    shape : round or box
        Of the hole.
    hole_mm : (x, y), mm
    plate_mm : (x, y), mm
        Outer size.
    thickness_mm : float, mm
        The marks lie on its upper face.
    mark_mm : float, mm
        Side of a mark, its black border included.
    process : str
        How it is made.
    u_scale : float
        Standard uncertainty of its scale, as a share.
    u_mark_mm : float, mm
        Standard uncertainty of a single mark's place along each axis.
    scale : float
        Made over drawn, as measured.
    marks, crosses : tuple
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printctl_insert: Literal[1] = 1
    dish: str
    shape: Literal["round", "box"]
    hole_mm: tuple[Positive, Positive]
    plate_mm: tuple[Positive, Positive]
    thickness_mm: Positive
    mark_mm: Positive
    process: Process
    u_scale: Positive
    u_mark_mm: Positive
    scale: Annotated[float, Field(gt=0.9, lt=1.1)] = 1.0
    marks: Annotated[tuple[Mark, ...], Field(min_length=FEWEST_MARKS)]
    crosses: tuple[Cross, ...]

    @property
    def numbers(self) -> list[int]:
        """Of the marks, in order."""
        return [mark.number for mark in self.marks]

    def corners(self) -> FloatArray:
        """Corners of the marks, (n, 4, 2) mm: upper left, upper right, lower right, lower left."""
        middles = np.array([[mark.x_mm, mark.y_mm] for mark in self.marks])
        half = self.mark_mm / 2
        return middles[:, None] + half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1.0]])

    @property
    def tolerance(self) -> Tolerance:
        """Of its way of making."""
        return TOLERANCES[self.process]

    def cells(self) -> FloatArray:
        """Black squares of all marks, (k, 2) mm: lower left corners; each `cell_mm` wide."""
        squares = []
        for mark in self.marks:
            rows, columns = np.nonzero(mark_bits(mark.number))
            left, top = mark.x_mm - self.mark_mm / 2, mark.y_mm + self.mark_mm / 2
            x, y = left + columns * self.cell_mm, top - (rows + 1) * self.cell_mm
            squares.append(np.column_stack([x, y]))
        return np.concatenate(squares)

    @property
    def cell_mm(self) -> float:
        """Side of a mark's cell."""
        return self.mark_mm / CELLS

    def bars(self) -> list[tuple[float, float, float, float]]:
        """Arms of the crosses as rectangles: left, bottom, width, height; mm."""
        arm, wide = _CROSS_ARM * self.mark_mm, 0.3 * self.cell_mm
        rectangles = []
        for cross in self.crosses:
            x, y = cross.x_mm, cross.y_mm
            rectangles.append((x - arm, y - wide / 2, 2 * arm, wide))
            rectangles.append((x - wide / 2, y - arm, wide, 2 * arm))
        return rectangles

    def measured(self, name: str, length_mm: float, u_mm: float) -> Insert:
        """Insert whose scale is that of a length measured between two opposite crosses.

        Parameters
        ----------
        name : str
            Of the first: ``left`` (to ``right``) or ``front`` (to ``back``).
        length_mm, u_mm : float, mm
            What was measured, and its standard uncertainty.

        Raises
        ------
        PictureError
            When there is no such cross, or the length is far from what was drawn.
        """
        other = {"left": "right", "front": "back"}.get(name)
        places = {cross.name: (cross.x_mm, cross.y_mm) for cross in self.crosses}
        if other is None or name not in places or other not in places:
            raise PictureError(f"there are no crosses from {name!r} on; measure left or front")
        drawn = float(np.hypot(*np.subtract(places[name], places[other])))
        scale = length_mm / drawn
        if not abs(scale - 1) < 0.03:
            raise PictureError(
                f"between the crosses {name} and {other} {length_mm:g} mm were measured, and "
                f"{drawn:g} mm drawn (3 % may lie between them): was it made at 100 %?"
            )
        return self.model_copy(update={"scale": scale, "u_scale": max(u_mm / drawn, 1e-5)})


def mark_bits(number: int) -> NDArray[np.bool_]:
    """Cells of a mark, (6, 6), True where black."""
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{DICTIONARY}"))
    return np.asarray(book.generateImageMarker(number, CELLS)) == 0


def design_insert(
    dish: Dish,
    *,
    mark_mm: float = 8.0,
    thickness_mm: float = 3.0,
    hole_mm: float | None = None,
    process: Process = "fdm",
) -> Insert:
    """Design an insert for a dish: marks all around on a band, a cross amid each side.

    Parameters
    ----------
    dish : Dish
    mark_mm : float, mm
    thickness_mm : float, mm
    hole_mm : float, mm, optional
        Across, along x; 4 mm more than the dish inside, if not given (walls and play).
    process : str

    Raises
    ------
    PictureError
        When the marks don't fit, or sizes make no sense.
    """
    wider = 4.0 if hole_mm is None else hole_mm - dish.inner_x_mm
    if not wider > 0:
        raise PictureError(
            f"a hole of {hole_mm:g} mm is no wider than the dish inside ({dish.inner_x_mm:g} mm); "
            "measure the dish outside and add 0.5 mm"
        )
    if not 3.0 <= mark_mm <= 30.0 or not 0.05 <= thickness_mm <= 30.0:
        raise PictureError(
            f"marks of {mark_mm:g} mm and a thickness of {thickness_mm:g} mm can't be: marks 3 to "
            "30 mm, thickness 0.05 to 30 mm"
        )
    hole = (dish.inner_x_mm + wider, dish.inner_y_mm + wider)
    band = mark_mm * (1 + 2 / CELLS)  # a cell of white on either side
    plate = (hole[0] + 2 * band, hole[1] + 2 * band)
    if max(plate) > _MOST_MM:
        raise PictureError(
            f"the insert would be {max(plate):g} mm wide ({_MOST_MM:g} at most); take smaller marks"
        )
    places = _places(hole, band)
    if not FEWEST_MARKS <= len(places) <= _MOST_MARKS:
        remedy = "smaller" if len(places) < FEWEST_MARKS else "larger"
        raise PictureError(
            f"{len(places)} marks of {mark_mm:g} mm fit around the dish ({FEWEST_MARKS} to "
            f"{_MOST_MARKS} wanted); take {remedy} ones"
        )
    x, y = (hole[0] + band) / 2, (hole[1] + band) / 2
    amid = {"left": (-x, 0.0), "right": (x, 0.0), "front": (0.0, -y), "back": (0.0, y)}
    return Insert(
        dish=dish.name,
        shape=dish.shape,
        hole_mm=hole,
        plate_mm=plate,
        thickness_mm=thickness_mm,
        mark_mm=mark_mm,
        process=process,
        u_scale=TOLERANCES[process].scale,
        u_mark_mm=TOLERANCES[process].mark_mm,
        marks=tuple(Mark(number=n, x_mm=a, y_mm=b) for n, (a, b) in enumerate(places)),
        crosses=tuple(Cross(name=name, x_mm=a, y_mm=b) for name, (a, b) in amid.items()),
    )


def _places(hole: tuple[float, float], band: float) -> list[tuple[float, float]]:
    """Middles of the marks: the four corners, and both halves of each side, the cross left free."""
    x, y = (hole[0] + band) / 2, (hole[1] + band) / 2
    across, along = _half_side(x, band), _half_side(y, band)
    places = [(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)]
    places += [(s * a, t * y) for a in across for s in (-1, 1) for t in (-1, 1)]
    places += [(s * x, t * b) for b in along for s in (-1, 1) for t in (-1, 1)]
    return [(round(a, 4), round(b, 4)) for a, b in places]


def _half_side(corner: float, band: float) -> list[float]:
    """Even places between the cross amid a side and the mark at its corner."""
    free = corner - 0.9 * band  # the cross takes 0.8 of a band in all
    count = int(free / band)
    return [corner - (k + 1) * free / count for k in range(count)] if count else []


def write_insert(path: Path, insert: Insert) -> None:
    """Write an insert that `read_insert` reads back exactly.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    write_text(path, yaml.safe_dump(insert.model_dump(mode="json"), sort_keys=False))


def read_insert(path: Path) -> Insert:
    """Read an insert.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, Insert, "--insert", "printctl observe insert")
