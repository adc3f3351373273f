"""Result of checking a mesh file: counts, faults, volume, and whether it is a valid solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.errors import SolidError

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
        manifold3d takes the mesh as a 2-manifold, and finds the same volume. Not asked again of
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
