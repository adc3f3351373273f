"""Read a written mesh file back and check its surface: closed, oriented, without crossings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from manifold3d import Error, Manifold, Mesh64
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.geometry.surface import Surface
from design.solids.read import load_mesh
from design.solids.solid import Solid
from design.solids.topology import edge_faults, surface_genus

if TYPE_CHECKING:
    import trimesh

Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (n, 3) and faces (m, 3)."""

SELF_INTERSECTION: Final = (
    "all pairs of triangles whose boxes meet are tried, neighbours too, exactly: counted are those "
    "that meet in more than the corners and edges which both have (design/geometry/crossings.py). "
    "It isn't part of `valid`: readers take such files"
)
"""What the test for crossing faces covers."""


@dataclass(frozen=True)
class SolidCheck:
    """What a file holds, in the file's own unit.

    Attributes
    ----------
    file : str
        Name of the file.
    vertices, faces : int
    watertight : bool
        Every edge has two faces, as trimesh counts after merging equal vertices.
    oriented : bool
        Those two run along it in opposite directions, and the volume is above 0.
    manifold : bool
        manifold3d takes the mesh as a 2-manifold, and finds the same volume.
    volume : float
        By the divergence theorem; mm³ for a file in mm.
    genus : int or None
        Handles, summed over the shells: shells - (vertices - edges + faces)/2 by Euler. None
        where edges are open or wrong.
    shells : int or None
        Closed surfaces that aren't joined (an enclosed cavity is one).
    open_edges, wrong_edges : int
        Edges with one face; edges with several or opposed ones.
    crossing_faces : int
        That pass through another one, touch it, or are folded onto it.
    self_intersection : str
        What that test covers.
    """

    file: str
    vertices: int
    faces: int
    watertight: bool
    oriented: bool
    manifold: bool
    volume: float
    genus: int | None
    shells: int | None
    open_edges: int
    wrong_edges: int
    crossing_faces: int
    self_intersection: str = SELF_INTERSECTION

    @property
    def valid(self) -> bool:
        """Whether it is watertight, oriented and manifold."""
        return self.watertight and self.oriented and self.manifold

    def require_valid(self) -> None:
        """Raise `SolidError` when a check doesn't hold, with what is wrong."""
        if self.valid:
            return
        raise SolidError(
            f"{self.file}: not a valid solid (watertight {self.watertight}, oriented "
            f"{self.oriented}, manifold {self.manifold}; {self.open_edges} open and "
            f"{self.wrong_edges} wrong edges of {3 * self.faces // 2}, volume {self.volume:g}); "
            "mend the mesh before it is sliced"
        )


def validate_files(paths: Sequence[Path], made: Sequence[Solid] = ()) -> dict[str, SolidCheck]:
    """Read files back and check each as `validate_file` does; by name.

    Files that hold the same triangles are checked once. Crossings aren't looked for again in a
    file that holds exactly the triangles of a solid in which none were found (``made``, some).

    Raises
    ------
    SolidError, OSError
        As `validate_file`.
    """
    found: dict[str, SolidCheck] = {}
    known: list[tuple[Triangles, SolidCheck]] = []
    uncrossed = [solid for solid in made if solid.uncrossed]
    for path in paths:
        mesh = load_mesh(path)
        read = _triangles(mesh)
        check = next((check for other, check in known if _same(read, other)), None)
        if check is None:
            check = _checked(mesh, path, any(_holds(read, solid) for solid in uncrossed))
            known.append((read, check))
        found[path.name] = replace(check, file=path.name)
    return found


def validate_file(path: Path) -> SolidCheck:
    """Read ``path`` back; check it by trimesh and manifold3d, and every face against every other.

    Raises
    ------
    SolidError
        When the file can't be read as a mesh.
    OSError
        When it can't be opened.
    """
    return _checked(load_mesh(path), path)


def _triangles(mesh: trimesh.Trimesh) -> Triangles:
    """Vertices (n, 3) and faces (m, 3), without what trimesh keeps beside them."""
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    return vertices, np.ascontiguousarray(mesh.faces, dtype=np.int64)


def _same(one: Triangles, other: Triangles) -> bool:
    """Whether two meshes, both with equal vertices merged, are the same triangles in order."""
    return np.array_equal(one[1], other[1]) and np.array_equal(one[0], other[0])


def _holds(read: Triangles, solid: Solid) -> bool:
    """Whether a file holds a solid's triangles, in order, to the last digit."""
    vertices, faces = read
    if faces.shape != solid.faces.shape or len(vertices) != len(solid.vertices):
        return False
    # A place has one number in either: as many numbers, and each corner at the same place.
    return all(
        np.array_equal(vertices[faces[:, k]], solid.vertices[solid.faces[:, k]]) for k in range(3)
    )


def _checked(mesh: trimesh.Trimesh, path: Path, uncrossed: bool = False) -> SolidCheck:
    vertices, faces = _triangles(mesh)
    volume = Surface(vertices, faces).volume_mm3  # in the file's unit, whatever it is
    manifold = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    same = bool(np.isclose(manifold.volume(), volume, rtol=1e-6, atol=0.0))
    valid = manifold.status() == Error.NoError and same
    del manifold  # a large file's takes a gigabyte
    faults = edge_faults(faces)
    genus, shells = (None, None) if faults else surface_genus(faces)
    crossing = 0 if uncrossed else len(find_crossings(vertices, faces[_proper(faces)]).faces)
    return SolidCheck(
        file=path.name,
        vertices=len(vertices),
        faces=len(faces),
        watertight=bool(mesh.is_watertight),
        oriented=bool(mesh.is_winding_consistent) and volume > 0.0,
        manifold=valid,
        volume=volume,
        genus=genus,
        shells=shells,
        open_edges=faults.open,
        wrong_edges=faults.wrong,
        crossing_faces=crossing,
    )


def _proper(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Faces with three corners."""
    a, b, c = faces.T
    found: NDArray[np.bool_] = (a != b) & (b != c) & (c != a)
    return found
