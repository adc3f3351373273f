"""Test parts of the slicing benchmark: upright round lumens of exactly known section."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, OpType
from numpy.typing import NDArray

_ADD = OpType.Add
#: Sides of every circle, as in the figures that issue 5 quotes of other slicers: a lumen of
#: 0.42 mm is a polygon with room for a circle of 0.416.
SIDES = 24


@dataclass(frozen=True)
class Part:
    """A part with upright round lumens from its bottom to its top.

    Attributes
    ----------
    name : str
    centre : (n, 2) float64, mm
    diameter : (n,) float64, mm
    size : (3,) float64, mm
        Of the block; of the field of tubes.
    wall_mm : float
        Of each tube; 0 for a block.
    """

    name: str
    centre: NDArray[np.float64]
    diameter: NDArray[np.float64]
    size: tuple[float, float, float]
    wall_mm: float = 0.0

    def section(self) -> CrossSection:
        """The section at every height."""
        if self.wall_mm:
            tubes = [self._disc(k, self.wall_mm) for k in range(len(self.diameter))]
            body = CrossSection.batch_boolean(tubes, _ADD)
        else:
            body = CrossSection.square(self.size[:2])
        return body - CrossSection.batch_boolean(
            [self._disc(k, 0.0) for k in range(len(self.diameter))], _ADD
        )

    def _disc(self, lumen: int, more_mm: float) -> CrossSection:
        disc = CrossSection.circle(self.diameter[lumen] / 2 + more_mm, SIDES)
        return disc.translate(self.centre[lumen].tolist())

    @property
    def inscribed(self) -> NDArray[np.float64]:
        """Widest circle in each lumen, (n,), mm: what the part itself leaves open."""
        return np.asarray(self.diameter * np.cos(np.pi / SIDES))

    def write_stl(self, path: Path) -> None:
        """Write the part as a binary STL, mm."""
        mesh = Manifold.extrude(self.section(), self.size[2]).to_mesh()
        corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
        rows = np.zeros(
            len(corners), dtype=[("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("_", "<u2")]
        )
        rows["at"] = corners
        path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())


def _grid(columns: int, rows: int, size: tuple[float, float, float]) -> NDArray[np.float64]:
    x = (np.arange(columns) + 0.5) * size[0] / columns
    y = (np.arange(rows) + 0.5) * size[1] / rows
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def block() -> Part:
    """20 x 20 x 10 mm with 63 lumens of 0.42 to 1.2 mm."""
    size = (20.0, 20.0, 10.0)
    return Part("block", _grid(9, 7, size), np.linspace(0.42, 1.2, 63), size)


def tubes() -> Part:
    """The same lumens as tubes with walls of 0.25 mm."""
    size = (20.0, 20.0, 10.0)
    return Part("tubes", _grid(9, 7, size), np.linspace(0.42, 1.2, 63), size, 0.25)


def small() -> Part:
    """4 x 4 x 1.2 mm with six lumens of 0.15 to 0.3 mm."""
    size = (4.0, 4.0, 1.2)
    return Part("small lumens", _grid(3, 2, size), np.linspace(0.15, 0.3, 6), size)


def channel() -> Part:
    """2 x 2 x 0.8 mm with one lumen of 0.1 mm, for a finer needle."""
    return Part("0.1 mm channel", np.array([[1.0, 1.0]]), np.array([0.1]), (2.0, 2.0, 0.8))
