"""Write a solid as binary PLY, optionally with a value per vertex."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.files import write_bytes
from design.solids.solid import Solid


def write_ply(
    path: Path,
    solid: Solid,
    scalar: NDArray[np.floating] | None = None,
    scalar_name: str = "scalar",
) -> None:
    """Write ``solid`` as little-endian PLY in mm.

    Parameters
    ----------
    path : Path
    solid : Solid
    scalar : (n,), optional
        One value a vertex, such as a signed deviation; NaN where there is none.
    scalar_name : str
        Its property in the file; give the unit in it, as in ``deviation_um``.

    Raises
    ------
    SolidError
        When ``scalar`` hasn't one value a vertex, or its name isn't one word.
    OSError
        When the file can't be written.
    """
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if scalar is not None:
        if scalar.shape != (len(solid.vertices),):
            raise SolidError(
                f"{scalar_name}: shape {scalar.shape} for {len(solid.vertices)} vertices; "
                "give one value each"
            )
        if not scalar_name.isidentifier() or scalar_name in "xyz":
            raise SolidError(f"scalar_name {scalar_name!r}: give one word of letters and digits")
        fields.append((scalar_name, "<f4"))
    vertices = np.empty(len(solid.vertices), dtype=fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = solid.vertices[:, axis]
    if scalar is not None:
        vertices[scalar_name] = scalar
    faces = np.empty(len(solid.faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, solid.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment printctl; mm",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name, _ in fields),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    write_bytes(path, "\n".join(header).encode() + vertices.tobytes() + faces.tobytes())
