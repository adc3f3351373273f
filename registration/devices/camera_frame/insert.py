"""Dish insert with marks at known places, its drawing and its solid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import cv2
import numpy as np
import yaml
from manifold3d import CrossSection, FillRule, Manifold, OpType
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from pydantic import BaseModel, ConfigDict, Field

from design.files import atomic_replacement, write_text
from design.solids.files.write import write_stl
from design.solids.solid import Solid
from firmware_profiles.plates import Dish
from kernels.arrays import FloatArray
from registration.devices.lens.lens import read_model
from registration.errors import PictureError

Process = Literal["fdm", "resin", "paper", "engraved"]
SOLID: Final = ("fdm", "resin")
"""Ways of making that print bodies."""
_DPI: Final = 1200
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
            f"the fiducial plate would be {max(plate):g} mm wide ({_MOST_MM:g} at most); take "
            "smaller marks"
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


_LINE_MM: Final = 0.2
_TILES_MM: Final = 0.02
"""Cells are drawn wider by it, so that no hair of white shows between neighbours."""


def write_svg(path: Path, insert: Insert) -> None:
    """Write the insert as SVG, one unit a mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    wide, high = insert.plate_mm
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.4f}mm" height="{high:.4f}mm" '
        f'viewBox="0 0 {wide:.4f} {high:.4f}">',
        f'<rect width="{wide:.4f}" height="{high:.4f}" fill="#fff"/>',
        '<path fill="#000" d="',
        *(
            f"M{x + wide / 2:.4f} {high / 2 - y - h:.4f}h{w:.4f}v{h:.4f}h{-w:.4f}z"
            for x, y, w, h in _black(insert)
        ),
        '"/>',
        _hole_svg(insert),
        "</svg>",
    ]
    write_text(path, "\n".join(rows) + "\n")


def write_dots(path: Path, insert: Insert, dots_per_inch: int) -> None:
    """Write the insert as PNG or PDF (by the name's end), true size.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    image = Image.fromarray(drawn(insert, dots_per_inch / 25.4)).convert(
        "1", dither=Image.Dither.NONE
    )
    with atomic_replacement(path) as draft:
        if path.suffix.lower() == ".pdf":
            image.save(draft, "PDF", resolution=float(dots_per_inch))
        else:
            image.save(draft, "PNG", dpi=(dots_per_inch, dots_per_inch))


def drawn(insert: Insert, dots_per_mm: float) -> NDArray[np.uint8]:
    """Picture of the insert, (h, w), black 0 on white 255; its middle is the dish's."""
    wide, high = (round(side * dots_per_mm) for side in insert.plate_mm)
    image = Image.new("L", (wide, high), 255)
    pen = ImageDraw.Draw(image)
    hx, hy = insert.hole_mm[0] / 2 * dots_per_mm, insert.hole_mm[1] / 2 * dots_per_mm
    box = (wide / 2 - hx, high / 2 - hy, wide / 2 + hx, high / 2 + hy)
    line = max(1, round(_LINE_MM * dots_per_mm))
    (pen.ellipse if insert.shape == "round" else pen.rectangle)(box, outline=0, width=line)
    for x, y, w, h in _black(insert, 0.0):
        left, right = wide / 2 + x * dots_per_mm, wide / 2 + (x + w) * dots_per_mm
        top, bottom = high / 2 - (y + h) * dots_per_mm, high / 2 - y * dots_per_mm
        # A rectangle's last dot is drawn.
        pen.rectangle((round(left), round(top), round(right) - 1, round(bottom) - 1), fill=0)
    return np.asarray(image)


def _black(insert: Insert, wider: float = _TILES_MM) -> list[tuple[float, float, float, float]]:
    """Rectangles: left, bottom, width, height; mm."""
    side = insert.cell_mm
    cells = [
        (x - wider / 2, y - wider / 2, side + wider, side + wider)
        for x, y in insert.cells().tolist()
    ]
    return [*cells, *insert.bars()]


def _hole_svg(insert: Insert) -> str:
    wide, high = insert.plate_mm
    x, y = insert.hole_mm
    look = f'fill="none" stroke="#000" stroke-width="{_LINE_MM}"'
    if insert.shape == "round":
        return f'<circle cx="{wide / 2:.4f}" cy="{high / 2:.4f}" r="{x / 2:.4f}" {look}/>'
    return (
        f'<rect x="{(wide - x) / 2:.4f}" y="{(high - y) / 2:.4f}" width="{x:.4f}" '
        f'height="{y:.4f}" {look}/>'
    )


_JOIN_MM: Final = 0.005
"""Cells are wider by it on each side: those that meet at a corner alone are joined."""
_FACETS: Final = 256
_BLACK_MM: Final = 0.6
"""Depth of the pockets."""


def insert_solids(insert: Insert) -> tuple[Solid, Solid]:
    """Return the white plate with pockets, and the black that fills them; z = 0 is below.

    Both end at the same height. A relief would shift its edges in a picture taken from aside: by
    its height times the tangent of the angle.

    Parameters
    ----------
    insert : Insert

    Raises
    ------
    PictureError
        When the pockets would go through the plate.
    """
    thick = insert.thickness_mm
    if not 0 < _BLACK_MM < thick - 0.2:
        raise PictureError(
            f"black of {_BLACK_MM:g} mm leaves less than 0.2 mm of a plate of {thick:g} mm; give a "
            "thickness of 1 mm or more"
        )
    wide, high = insert.plate_mm
    plate = _rectangle(-wide / 2, -high / 2, wide, high) - _hole(insert)
    side = insert.cell_mm + 2 * _JOIN_MM
    cells = [_rectangle(x - _JOIN_MM, y - _JOIN_MM, side, side) for x, y in insert.cells().tolist()]
    bars = [_rectangle(*bar) for bar in insert.bars()]
    black = CrossSection.batch_boolean(cells + bars, OpType.Add)
    inlay = Manifold.extrude(black, _BLACK_MM).translate((0.0, 0.0, thick - _BLACK_MM))
    tall = Manifold.extrude(black, _BLACK_MM + 1.0).translate((0.0, 0.0, thick - _BLACK_MM))
    body = Manifold.extrude(plate, thick) - tall
    return _solid(body), _solid(inlay)


def _rectangle(x: float, y: float, wide: float, high: float) -> CrossSection:
    corners = np.array([[x, y], [x + wide, y], [x + wide, y + high], [x, y + high]])
    return CrossSection([corners], FillRule.Positive)


def _hole(insert: Insert) -> CrossSection:
    x, y = insert.hole_mm
    if insert.shape == "round":
        return CrossSection.circle(x / 2, _FACETS)
    return _rectangle(-x / 2, -y / 2, x, y)


def _solid(body: Manifold) -> Solid:
    mesh = body.to_mesh64()
    vertices = np.asarray(mesh.vert_properties)[:, :3].astype(np.float32).astype(np.float64)
    return Solid(vertices, np.asarray(mesh.tri_verts, dtype=np.int32))


def write_files(folder: Path, insert: Insert) -> None:
    """Write `insert.yaml`, `insert.svg`, `.pdf` and `.png`; of a printed one its two bodies, too.

    The bodies, `insert_white.stl` and `insert_black.stl`, lie flush in one another.
    """
    solids = insert_solids(insert) if insert.process in SOLID else None
    folder.mkdir(parents=True, exist_ok=True)
    write_insert(folder / "insert.yaml", insert)
    write_svg(folder / "insert.svg", insert)
    write_dots(folder / "insert.png", insert, _DPI)
    write_dots(folder / "insert.pdf", insert, _DPI)
    for name, solid in zip(("white", "black"), solids or (), strict=False):
        write_stl(folder / f"insert_{name}.stl", solid)
