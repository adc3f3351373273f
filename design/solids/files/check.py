"""Read a written mesh file back and check its surface: closed, oriented, without crossings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from manifold3d import Error, Manifold, Mesh64
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.geometry.mesh import merge_equal, without_collapsed
from design.geometry.mesh_files import read_float32
from design.geometry.surface import Surface
from design.geometry.threemf_read import read_3mf
from design.solids.files.read import load_mesh
from design.solids.solid import Solid
from design.solids.topology import edge_faults, surface_genus

if TYPE_CHECKING:
    import trimesh


Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (n, 3) and faces (m, 3)."""


def validate_files(paths: Sequence[Path], made: Sequence[Solid] = ()) -> dict[str, SolidCheck]:
    """Read files back and check each as `validate_file` does; by name.

    A file that holds exactly the triangles of one of the solids ``made`` takes over that solid's
    own check (`check_made`), which is done once. Of others those that hold the same triangles are
    checked once.

    Raises
    ------
    SolidError, OSError
        As `validate_file`.
    """
    checks: dict[str, SolidCheck] = {}
    known: list[tuple[Triangles, SolidCheck]] = []
    of_made: dict[int, SolidCheck | None] = {}
    for path in paths:
        check = _of_made(path, made, of_made)
        if check is None:
            mesh = load_mesh(path)
            read = _triangles(mesh)
            check = next((check for other, check in known if _same(read, other)), None)
            if check is None:
                check = _checked(mesh, path)
                known.append((read, check))
        checks[path.name] = replace(check, file=path.name)
    return checks


def _of_made(
    path: Path, made: Sequence[Solid], checks: dict[int, SolidCheck | None]
) -> SolidCheck | None:
    """The check of the solid that a file holds; None where it is none, or that one has faults."""
    number = held_solid(path, made)
    if number is None:
        return None
    if number not in checks:
        checks[number] = check_made(made[number])
    return checks[number]


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


def _checked(mesh: trimesh.Trimesh, path: Path) -> SolidCheck:
    vertices, faces = _triangles(mesh)
    volume = Surface(vertices, faces).volume_mm3  # in the file's unit, whatever it is
    manifold = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    same = bool(np.isclose(manifold.volume(), volume, rtol=1e-6, atol=0.0))
    valid = manifold.status() == Error.NoError and same
    del manifold  # a large file's takes a gigabyte
    faults = edge_faults(faces)
    genus, shells = (None, None) if faults else surface_genus(faces)
    crossing = len(find_crossings(vertices, without_collapsed(faces)).faces)
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


def held_solid(path: Path, made: Sequence[Solid]) -> int | None:
    """Number of the solid whose triangles a file holds, in order, to the last bit; None without.

    Binary STL and 3MF; other formats aren't read.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    kind = path.suffix.lower()
    if kind == ".stl":
        corners = read_float32(path)
        return None if corners is None else _first(made, lambda one: _has_corners(one, corners))
    if kind != ".3mf":
        return None
    try:
        read = read_3mf(path)
    except SolidError:
        return None
    if read.unit != "millimeter" or read.notes:
        return None
    return _first(
        made,
        lambda one: (
            np.array_equal(read.vertices, one.vertices) and np.array_equal(read.faces, one.faces)
        ),
    )


def _first(made: Sequence[Solid], holds: Callable[[Solid], bool]) -> int | None:
    return next((number for number, solid in enumerate(made) if holds(solid)), None)


def _has_corners(solid: Solid, corners: NDArray[np.float32]) -> bool:
    """Whether ``corners`` (m, 3, 3) are those of the solid's faces."""
    if len(corners) != len(solid.faces):
        return False
    places = solid.vertices.astype(np.float32)
    return all(np.array_equal(corners[:, k], places[solid.faces[:, k]]) for k in range(3))


def check_made(solid: Solid) -> SolidCheck | None:
    """What `validate_file` finds in a file that holds ``solid``; None where anything is wrong.

    A reader merges equal corners. Where the solid's vertices are different places, that gives its
    own faces back, and where each edge has two faces that run along it in opposite directions,
    trimesh finds them watertight and wound alike and manifold3d takes them: those are its rules.
    What fails is checked from the file itself, by all three.
    """
    if len(merge_equal(solid.vertices)[0]) != len(solid.vertices):
        return None
    volume = solid.volume_mm3
    if not volume > 0.0 or edge_faults(solid.faces):
        return None
    genus, shells = surface_genus(solid.faces)
    crossing = 0 if solid.uncrossed else len(find_crossings(solid.vertices, solid.faces).faces)
    return SolidCheck(
        file="",
        vertices=int(np.count_nonzero(np.bincount(solid.faces.ravel()))),
        faces=len(solid.faces),
        watertight=True,
        oriented=True,
        manifold=True,
        volume=volume,
        genus=genus,
        shells=shells,
        open_edges=0,
        wrong_edges=0,
        crossing_faces=crossing,
    )


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
        manifold3d takes the mesh as a 2-manifold, and finds the same volume. Not repeated for
        a file that holds a solid just made, whose edges all pair (`check_made`).
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
