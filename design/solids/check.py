"""Whether a mesh file holds a solid, judged on the file read back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from manifold3d import Error, Manifold, Mesh64

from design.errors import SolidError
from design.solids.read import load_mesh
from design.solids.topology import edge_faults, surface_genus

SELF_INTERSECTION: Final = (
    "not tested on the file: where surfaces from here can't cross is in how they are made. A "
    "junction is star-shaped about its middle; vessels that come near without being joined are "
    "found as capsules, and they and junctions in a crowd are united by manifold3d within its "
    "tolerance. Not looked at: what rounding to float32 folds, by at most one float32 step (more "
    "where design/solids/snap.py had to simplify), and a vessel that bends back into itself "
    "within 2.5 times twice its radius"
)
"""What these checks don't cover."""


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
    self_intersection : str
        What is and what isn't known about it.
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
    self_intersection: str = SELF_INTERSECTION

    @property
    def valid(self) -> bool:
        """Whether all three checks hold."""
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


def validate_file(path: Path) -> SolidCheck:
    """Read ``path`` back and check it by trimesh and manifold3d.

    Raises
    ------
    SolidError
        When the file can't be read as a mesh.
    OSError
        When it can't be opened.
    """
    mesh = load_mesh(path)
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    volume = float(mesh.volume)
    manifold = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    same = bool(np.isclose(manifold.volume(), volume, rtol=1e-6, atol=0.0))
    faults = edge_faults(faces)
    genus, shells = (None, None) if faults else surface_genus(faces)
    return SolidCheck(
        file=path.name,
        vertices=len(vertices),
        faces=len(faces),
        watertight=bool(mesh.is_watertight),
        oriented=bool(mesh.is_winding_consistent) and volume > 0.0,
        manifold=manifold.status() == Error.NoError and same,
        volume=volume,
        genus=genus,
        shells=shells,
        open_edges=faults.open,
        wrong_edges=faults.wrong,
    )
