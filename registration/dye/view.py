"""Map design points to video pixels, by the user's marks file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.network import VesselNetwork
from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.devices.lens.perspective import (
    FEWEST,
    find_homography,
    mapped,
    reading_error,
    slopes,
    spread_out,
)
from registration.errors import DyeError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Side = Literal["z", "-z", "x", "-x", "y", "-y"]


class Mark(BaseModel):
    """A point of the design, by node or in mm, and the pixel it is seen at."""

    model_config = ConfigDict(extra="forbid")

    node: Annotated[int, Field(ge=0)] | None = None
    at_mm: tuple[Finite, Finite, Finite] | None = None
    pixel: tuple[Finite, Finite]


class Marks(BaseModel):
    """Contents of a marks file.

    Attributes
    ----------
    marks : list of Mark
        At least two.
    side : str
        The camera's side of the part: z (from above), -z, x, -x, y or -y.
    mirrored : bool
        Whether the film was taken by way of a mirror.
    inlet : int or None
        Node the dye enters at; else the network's own inlets.
    """

    model_config = ConfigDict(extra="forbid")

    marks: Annotated[list[Mark], Field(min_length=2)]
    side: Side = "z"
    mirrored: bool = False
    inlet: Annotated[int, Field(ge=0)] | None = None


def read_marks(path: Path) -> Marks:
    """Read a marks file (docs/dye.md).

    Raises
    ------
    DyeError
        When it isn't there, isn't YAML, or doesn't hold what it should.
    """
    try:
        plain = read_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise DyeError(f"{path} doesn't exist; docs/dye.md says what marks are") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise DyeError(f"{path}: not YAML ({exc}); mend it") from exc
    try:
        return Marks.model_validate(plain if plain is not None else {})
    except ValidationError as exc:
        first = exc.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise DyeError(
            f"{path}: {place}: {wording(first)}; write marks: [{{node: 0, pixel: [u, v]}}, ...], "
            "two at least (docs/dye.md)"
        ) from exc


def straight_marks(marks: Marks, lens: Lens) -> Marks:
    """The same marks in pictures without the lens' distortion."""
    pixels = lens.straight_pixels(np.array([mark.pixel for mark in marks.marks]))
    moved = [
        mark.model_copy(update={"pixel": (float(u), float(v))})
        for mark, (u, v) in zip(marks.marks, pixels, strict=True)
    ]
    return marks.model_copy(update={"marks": moved})


def marked_points(marks: Marks, network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Points of the design (n, 3), mm, and their pixels (n, 2).

    Raises
    ------
    DyeError
        When a mark names no point, two, or a node that isn't there.
    """
    points = []
    for index, mark in enumerate(marks.marks):
        if (mark.node is None) == (mark.at_mm is None):
            raise DyeError(f"marks.{index}: give either node or at_mm, and not both")
        if mark.node is not None:
            points.append(network.nodes[checked_node(mark.node, network, f"marks.{index}")])
        else:
            points.append(np.array(mark.at_mm))
    return np.array(points), np.array([mark.pixel for mark in marks.marks])


def checked_node(node: int, network: VesselNetwork, place: str) -> int:
    """The node, if the network has it.

    Raises
    ------
    DyeError
        When it hasn't.
    """
    if node >= len(network.nodes):
        raise DyeError(
            f"{place}: node {node} isn't one of the network's 0 to {len(network.nodes) - 1} "
            "(network.csv: node0, node1)"
        )
    return node


_RIGHT_AND_UP: Final = {
    # Seen from that side of the part: axis to the right, axis upwards.
    "z": ((1, 0, 0), (0, 1, 0)),
    "-z": ((1, 0, 0), (0, -1, 0)),
    "y": ((1, 0, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, 1)),
    "x": ((0, 1, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (0, 0, -1)),
}
LEAST_PX = 2.0
"""How far off marks are read."""
_READ, _STEEPEST_DEG = 0.25, 60.0


@dataclass(frozen=True)
class View:
    """A camera's view of the part.

    Attributes
    ----------
    right, down : (3,) float64
        Axes of the part along the picture's before it is turned.
    matrix : (3, 3) float64
        From (right, down, 1), mm, to the pixel (u, v, 1) times a weight.
    middle : (2,) float64, mm
        Of the marks along right and down.
    mirrored : bool
    residual_mm : float, mm
        Of a similarity: root mean square over the marks, 0 with two, which always fit. Of a
        perspective: the same over the n - 4 that aren't needed for it, 0 with four.
    perspective : bool
        Whether the matrix is more than a similarity.
    either_way : bool
        The marks fit a mirrored picture as well.
    """

    right: FloatArray
    down: FloatArray
    matrix: FloatArray
    middle: FloatArray
    mirrored: bool
    residual_mm: float
    perspective: bool = False
    either_way: bool = False

    @property
    def px_per_mm(self) -> float:
        """Scale of the picture at the marks' middle, not foreshortened."""
        return float(np.linalg.norm(slopes(self.matrix, self.middle[None])[0], 2))

    @property
    def tilt_deg(self) -> float:
        """Of the line of sight to the plane's normal at the marks' middle, by foreshortening."""
        wide, narrow = np.linalg.svd(slopes(self.matrix, self.middle[None])[0])[1]
        share = float(narrow / max(float(wide), 1e-12))
        return float(np.degrees(np.arccos(min(share, 1.0)))) if self.perspective else 0.0

    def places(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) along right and down, (n, 2), mm."""
        return np.stack([points @ self.right, points @ self.down], axis=1)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); (0, 0) is the first pixel's middle."""
        return mapped(self.matrix, self.places(points))

    def scales(self, points: FloatArray) -> FloatArray:
        """px/mm at points (n, 3), not foreshortened: a tube's width in the picture, (n,)."""
        if not self.perspective:
            return np.full(len(points), self.px_per_mm)
        here = slopes(self.matrix, self.places(points))
        return np.asarray(np.linalg.norm(here, 2, axis=(1, 2)))


def find_view(marks: Marks, network: VesselNetwork) -> View:
    """Fit a similarity to the marks; where four or more don't fit one, a homography.

    Four fit a similarity if they are off by no more than two pixels, or a quarter of the thinnest
    lumen's radius if that is more.

    Raises
    ------
    DyeError
        Marks on one point, mirrored ones that don't say so, ones that are off by more than the
        median lumen's radius (or two pixels); for a tilted view too few, in line, too near each
        other, or vessels out of their plane.
    """
    points, pixels = marked_points(marks, network)
    view, other = (_similar(points, pixels, marks, marks.mirrored ^ flip) for flip in (False, True))
    limit = max(float(np.median(network.radius)), LEAST_PX / max(view.px_per_mm, 1e-9))
    # Nearer than marks are read, a tilt can't be told from how they were read.
    exact = max(_READ * float(network.radius.min()), LEAST_PX / max(view.px_per_mm, 1e-9))
    few = len(points) < FEWEST
    if view.residual_mm <= (limit if few else exact):
        return replace(view, either_way=other.residual_mm <= limit)
    off = f"marks are off by {view.residual_mm:.3g} mm, above {limit:.3g}"
    if other.residual_mm <= limit < view.residual_mm and len(points) > 2:
        raise DyeError(_turn_over(off, marks, f"to {other.residual_mm:.2g} mm"))
    if few:
        raise DyeError(
            f"{off}; check each mark's pixel (column, row from the top left) and side; if the "
            "camera was tilted, mark four points or more, no three in line"
        )
    return _tilted(view, points, pixels, marks, network, limit)


def _turn_over(off: str, marks: Marks, how: str) -> str:
    setting = "mirrored: false" if marks.mirrored else "mirrored: true, if a mirror was used,"
    return (
        f"{off}; they fit a mirrored picture {how}: put {setting} or the other side than side: "
        f"{marks.side} into the marks"
    )


def _similar(points: FloatArray, pixels: FloatArray, marks: Marks, mirrored: bool) -> View:
    """Least squares of u + iv = factor · (right + i·down) + shift, the conjugate if mirrored."""
    right, up = (np.array(axis, dtype=np.float64) for axis in _RIGHT_AND_UP[marks.side])
    seen = points @ right - 1j * (points @ up)
    middle = np.array([seen.real.mean(), seen.imag.mean()])
    seen = np.conj(seen) if mirrored else seen
    placed = pixels[:, 0] + 1j * pixels[:, 1]
    a, b = seen - seen.mean(), placed - placed.mean()
    spread = float(np.sum(np.abs(a) ** 2))
    if spread < 1e-6 or float(np.sum(np.abs(b) ** 2)) < 1.0:
        raise DyeError(
            f"marks lie on one point, seen from side {marks.side}; take two far from each other"
        )
    factor = complex(np.sum(np.conj(a) * b) / spread)
    scale = max(abs(factor), 1e-9)
    residual = float(np.sqrt(np.mean(np.abs(b - factor * a) ** 2))) / scale
    shift = complex(placed.mean() - factor * seen.mean())
    flip = -1.0 if mirrored else 1.0
    matrix = np.array([
        [factor.real, -flip * factor.imag, shift.real],
        [factor.imag, flip * factor.real, shift.imag],
        [0.0, 0.0, 1.0],
    ])  # fmt: skip
    return View(right, -up, matrix, middle, mirrored, residual)


def _tilted(
    straight: View,
    points: FloatArray,
    pixels: FloatArray,
    marks: Marks,
    network: VesselNetwork,
    limit: float,
) -> View:
    places = straight.places(points)
    off = f"marks don't fit a camera that looks straight (off by {straight.residual_mm:.3g} mm)"
    if not spread_out(places) or not spread_out(pixels):
        raise DyeError(
            f"{off}, and can't tell how it was tilted: three of every four lie in line; mark four "
            "points or more with no three of them in line, or check each mark's pixel"
        )
    matrix, spread = find_homography(places, pixels)
    rest = float(np.sum((mapped(matrix, places) - pixels) ** 2))
    view = replace(straight, matrix=matrix, perspective=True, residual_mm=0.0)
    if len(points) > FEWEST:
        error = np.sqrt(rest / (len(points) - FEWEST)) / view.px_per_mm
        view = replace(view, residual_mm=float(error))
    _check_fit(view, places, marks, network, limit, off)
    _check_plane(view, points, network, limit)
    _check_reach(view, spread, network, limit)
    return view


def _check_fit(
    view: View, places: FloatArray, marks: Marks, network: VesselNetwork, limit: float, off: str
) -> None:
    """A view that a camera can have, and that fits the marks."""
    check = "check each mark's pixel (column, row from the top left) and side"
    all_places = np.concatenate([places, view.places(network.points)])
    weight = all_places @ view.matrix[2, :2] + view.matrix[2, 2]
    if not (weight / weight[0] > 0.0).all() or view.tilt_deg > _STEEPEST_DEG:
        raise DyeError(f"{off}, nor one tilted by less than {_STEEPEST_DEG:g}°; {check}")
    if view.residual_mm > limit:
        raise DyeError(
            f"{off}, nor a tilted one: {view.residual_mm:.3g}, above {limit:.3g}; {check}"
        )
    if (np.linalg.det(slopes(view.matrix, view.middle[None])[0]) < 0.0) != view.mirrored:
        raise DyeError(_turn_over(off, marks, "tilted"))


def _check_plane(view: View, points: FloatArray, network: VesselNetwork, limit: float) -> None:
    """Vessels near enough to the marks' plane: what lies above it is seen aside."""
    towards = np.cross(view.right, view.down)
    height = np.concatenate([points, network.points]) @ towards - float((points @ towards).mean())
    aside = float(np.abs(height).max()) * float(np.tan(np.radians(view.tilt_deg)))
    if aside > limit:
        raise DyeError(
            f"the marks mean a camera tilted by {view.tilt_deg:.0f}°, and vessels and marks lie up "
            f"to {np.abs(height).max():.2g} mm off one plane: they are seen {aside:.2g} mm aside, "
            f"above {limit:.2g}; film straight, or mark points at the vessels' height"
        )


def _check_reach(view: View, spread: FloatArray, network: VesselNetwork, limit: float) -> None:
    """Marks that pin the view down all over the design."""
    points = network.points
    error = reading_error(view.matrix, spread, view.places(points)) / view.scales(points)
    if float(error.max()) > limit:
        x, y, z = points[int(np.argmax(error))]
        raise DyeError(
            f"a pixel's error in the marks is {error.max():.2g} mm at ({x:.3g}, {y:.3g}, {z:.3g}), "
            f"above {limit:.2g}; mark points farther apart, all round the design"
        )
