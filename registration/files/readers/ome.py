"""Read voxel sizes and axis order from OME-XML metadata (OME-TIFF)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from registration.errors import ScanFileError
from registration.files.readers.units import millimetres
from registration.files.readers.xml import parse_xml


def read_ome_xml(text: str, path: Path) -> dict[str, Any]:
    """Read the first image's ``Pixels`` (OME schema 2016-06: sizes in µm by default).

    Raises
    ------
    ScanFileError
        When there are several channels or time points.
    """
    pixels = parse_xml(text, path).find(".//{*}Pixels")
    if pixels is None:
        return {}
    for name, what in (("SizeC", "channels"), ("SizeT", "time points")):
        if pixels.get(name, "1") != "1":
            raise ScanFileError(f"{path}: has {pixels.get(name)} {what}; export one")
    order = pixels.get("DimensionOrder", "XYZCT")
    axes = "".join(name for name in reversed(order) if name in "XYZ").lower()
    known: dict[str, Any] = {"axes": axes}
    voxel = []
    for name in "ZYX":
        size = pixels.get(f"PhysicalSize{name}")
        unit = millimetres(pixels.get(f"PhysicalSize{name}Unit", "µm"), path)
        if size and unit:
            voxel.append(float(size) * unit)
    if len(voxel) == 3:
        known["voxel_mm"] = voxel
    return known
