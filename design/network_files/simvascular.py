"""Write a network as SimVascular paths: a folder of `.pth` files (XML), in cm."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from design.errors import NetworkError
from design.files import write_text
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_CM = 0.1
_FLAT = 1e-4


def write_simvascular_paths(
    folder: Path, network: VesselNetwork, spacing_mm: float = 0.5, name: str = "path"
) -> list[Path]:
    """Write a path for each run of vessels, for the ``Paths`` folder of a SimVascular project.

    Where vessels meet, the widest that leaves goes on with the path of the widest that enters,
    the next with the next; the others begin there. Files are ``name_0001.pth`` and so on, by the
    number of the first vessel. A path holds no radii; SimVascular draws those as contours.

    The control points are the polyline's, the path's points lie at most ``spacing_mm`` apart on
    it, each with its tangent and a normal (``rotation``). Editing a path in SimVascular fits its
    spline through the control points anew.

    Parameters
    ----------
    folder : Path
    network : VesselNetwork
    spacing_mm : float
    name : str
        Of the files.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    NetworkError
        When ``spacing_mm`` isn't above 0.
    OSError
        When a file can't be written.
    """
    if not (np.isfinite(spacing_mm) and spacing_mm > 0.0):
        raise NetworkError(f"spacing_mm is {spacing_mm:g}; give a value above 0")
    runs = vessel_runs(network)
    digits = max(4, len(str(len(runs))))
    files = []
    for number, run in enumerate(runs, start=1):
        files.append(folder / f"{name}_{number:0{digits}d}.pth")
        write_text(files[-1], _document(number, _joined(network, run), spacing_mm))
    return files


def vessel_runs(network: VesselNetwork) -> list[list[int]]:
    """Vessels in runs, first to last node; each vessel is in one run, each run goes with the flow.

    At each node the widest vessel that enters is followed by the widest that leaves, and so on.
    """
    first, last = network.vessel_nodes.T
    entering = _by_width(last, network.radius[network.offset[1:] - 1])
    leaving = _by_width(first, network.radius[network.offset[:-1]])
    heir = np.full(network.vessel_count, -1)
    for node, vessels in entering.items():
        for one, two in zip(vessels, leaving.get(node, ()), strict=False):
            heir[one] = two
    begins = np.ones(network.vessel_count, dtype=bool)
    begins[heir[heir >= 0]] = False
    runs: list[list[int]] = []
    seen = np.zeros(network.vessel_count, dtype=bool)
    # Rings have no beginning: they come last, begun anywhere.
    for start in (*np.flatnonzero(begins), *np.flatnonzero(~begins)):
        run: list[int] = []
        vessel = int(start)
        while vessel >= 0 and not seen[vessel]:
            seen[vessel] = True
            run.append(vessel)
            vessel = int(heir[vessel])
        if run:
            runs.append(run)
    return sorted(runs)


def _by_width(node: IntArray, radius: FloatArray) -> dict[int, list[int]]:
    """Vessels at each node, widest first."""
    vessels: dict[int, list[int]] = {}
    for i in np.argsort(-radius, kind="stable").tolist():
        vessels.setdefault(int(node[i]), []).append(i)
    return vessels


def _joined(network: VesselNetwork, run: list[int]) -> FloatArray:
    """Points of a run of vessels, (k, 3), mm, without repeated places."""
    points = np.concatenate([network.polyline(i)[0] for i in run])
    moves = np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0]
    kept: FloatArray = points[moves]
    return kept


def _along(points: FloatArray, spacing_mm: float) -> tuple[FloatArray, FloatArray]:
    """Places at most ``spacing_mm`` apart on a polyline, its own points among them; tangents."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    parts = np.maximum(1, np.ceil(length / spacing_mm)).astype(np.int64)
    piece = np.repeat(np.arange(len(step)), parts)
    part = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    place = points[piece] + step[piece] * (part / parts[piece])[:, None]
    tangent = (step / length[:, None])[piece]
    return np.concatenate([place, points[-1:]]), np.concatenate([tangent, tangent[-1:]])


def _normals(tangent: FloatArray) -> FloatArray:
    """Unit normals (n, 3) to unit tangents, by SimVascular's rule.

    (0, 1, -t_y/t_z) where t_z isn't nought, else (1, -t_x/t_y, 0), else (0, 0, 1), to length 1.
    """
    x, y, z = tangent.T
    nought, one = np.zeros_like(x), np.ones_like(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        steep = np.column_stack([nought, one, -y / z])
        level = np.column_stack([one, -x / y, nought])
    along_x = np.column_stack([nought, nought, one])
    chosen = np.where((np.abs(y) > _FLAT)[:, None], level, along_x)
    chosen = np.where((np.abs(z) > _FLAT)[:, None], steep, chosen)
    unit: FloatArray = chosen / np.linalg.norm(chosen, axis=1)[:, None]
    return unit


def _document(number: int, points: FloatArray, spacing_mm: float) -> str:
    """Text of a path file, as SimVascular's sv4guiPathIO writes and reads it."""
    place, tangent = _along(points, spacing_mm)
    normal = _normals(tangent)
    # Method 0 is a fixed total number of points.
    how = f'method="0" calculation_number="{len(place)}" spacing="0"'
    controls = "\n".join(_element("point", p * _CM, i) for i, p in enumerate(points))
    rows = "\n".join(
        f'<path_point id="{i}">{_element("pos", p * _CM)}{_element("tangent", t)}'
        f"{_element('rotation', n)}</path_point>"
        for i, (p, t, n) in enumerate(zip(place, tangent, normal, strict=True))
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<path id="{number}" {how} version="1.0" reslice_size="5" point_2D_display_size="" '
        f'point_size="">\n<timestep id="0">\n<path_element {how}>\n'
        f"<control_points>\n{controls}\n</control_points>\n"
        f"<path_points>\n{rows}\n</path_points>\n"
        "</path_element>\n</timestep>\n</path>\n"
    )


def _element(tag: str, values: FloatArray, number: int | None = None) -> str:
    numbered = "" if number is None else f" id={quoteattr(str(number))}"
    x, y, z = values.tolist()
    return f'<{tag}{numbered} x="{x!r}" y="{y!r}" z="{z!r}"/>'
