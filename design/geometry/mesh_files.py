"""Read the triangles of mesh files (STL, 3MF, PLY, OBJ, OFF) as they stand in the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.surface import START_BYTES, TRIANGLE, MeshFile


def read_mesh(path: Path, suffixes: tuple[str, ...]) -> MeshFile:
    """Read a mesh file; its vertices aren't merged, its faces not mended.

    Parameters
    ----------
    path : Path
    suffixes : tuple of str
        Those that are allowed, in small letters.

    Raises
    ------
    SolidError
        Other or unreadable format, or no triangles.
    OSError
        When the file can't be opened.
    """
    kind = path.suffix.lower()
    if path.is_dir():
        raise SolidError(f"{path} is a folder; give a file, one of {', '.join(suffixes)}")
    if kind not in suffixes:
        raise SolidError(f"{path}: {kind or 'no suffix'} isn't one of {', '.join(suffixes)}")
    if kind == ".3mf":
        from design.geometry.threemf_read import read_3mf  # loads lxml, for this format alone

        return read_3mf(path)
    if kind == ".stl":
        if missing := _cut_short(path):
            raise SolidError(f"{path}: {missing}; export or copy it again")
        if (corners := read_corners(path)) is not None:
            faces = np.arange(3 * len(corners)).reshape(-1, 3)
            return MeshFile(corners.reshape(-1, 3), faces)
    import trimesh  # heavy: scipy's statistics, networkx; a binary STL needs none of it

    with path.open("rb") as handle:
        try:
            mesh = trimesh.load_mesh(handle, file_type=kind[1:], process=False)
        except (OSError, MemoryError):
            raise
        except Exception as exc:  # trimesh and lxml raise what they like for a damaged file
            # For an STL that is no text either trimesh imports a detector of encodings.
            why = "neither binary nor plain text" if isinstance(exc, ImportError) else exc
            raise SolidError(
                f"{path}: not a readable {kind[1:].upper()} file ({type(exc).__name__}: {why}); "
                "export it again"
            ) from exc
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    faces = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if len(faces) == 0:
        raise SolidError(f"{path}: no triangles in the file; export the surface again")
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise SolidError(
            f"{path}: a triangle names a corner that isn't there (of {len(vertices)}); export "
            "the surface again"
        )
    return MeshFile(vertices, faces, str(mesh.units or ""))


def _cut_short(path: Path) -> str:
    """Describe what is missing of a binary STL whose header counts more than it holds; else ""."""
    with path.open("rb") as file:
        start = file.read(START_BYTES)
    present = (path.stat().st_size - START_BYTES) // TRIANGLE.itemsize
    count = int.from_bytes(start[80:84], "little")
    if len(start) < START_BYTES or start.lstrip().startswith(b"solid") or present >= count:
        return ""
    return f"the file is cut short: its header counts {count} triangles, and it holds {present}"


def read_corners(path: Path) -> NDArray[np.float64] | None:
    """Corners (n, 3, 3) of a binary STL's triangles; None where the file isn't exactly one.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    corners = read_float32(path)
    return None if corners is None else np.asarray(corners.astype(np.float64))


def read_float32(path: Path) -> NDArray[np.float32] | None:
    """As `read_corners`, in the file's own precision and not copied."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if count == 0 or len(data) != START_BYTES + count * TRIANGLE.itemsize:
        return None
    triangles = np.frombuffer(data, TRIANGLE, count, START_BYTES)
    return np.asarray(triangles["corners"])
