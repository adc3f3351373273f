"""Write a solid as a Wavefront OBJ file, in mm."""

from __future__ import annotations

from pathlib import Path

from design.files import write_text
from design.solids.solid import Solid


def write_obj(path: Path, solid: Solid) -> None:
    """Write ``solid`` as OBJ in mm (the format has no unit; a comment says it).

    Raises
    ------
    OSError
        When the file can't be written.
    """
    # Readers that hold doubles need all digits, or faces cross; OBJ counts vertices from 1.
    vertices = "v %.17g %.17g %.17g\n" * len(solid.vertices)
    faces = "f %d %d %d\n" * len(solid.faces)
    text = vertices % tuple(solid.vertices.ravel().tolist())
    text += faces % tuple((solid.faces + 1).ravel().tolist())
    write_text(path, "# printctl; mm\n" + text)
