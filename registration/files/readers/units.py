"""Convert the name of a length unit in an image file to millimetres."""

from __future__ import annotations

from pathlib import Path

from registration.errors import ScanFileError

_MM = {
    "m": 1e3, "meter": 1e3, "metre": 1e3, "cm": 10.0, "centimeter": 10.0, "centimetre": 10.0,
    "mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "µm": 1e-3, "μm": 1e-3, "um": 1e-3,
    "micron": 1e-3, "microns": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3,
    "nm": 1e-6, "nanometer": 1e-6, "nanometre": 1e-6, "inch": 25.4,
}  # fmt: skip


def millimetres(unit: str | None, path: Path) -> float | None:
    """Return a unit's length in mm; None for unknown ones ("pixel" or nothing).

    Raises
    ------
    ScanFileError
        When the unit isn't a length that is known.
    """
    plain = (unit or "").strip().strip("\x00").lower().replace("\\u00b5m", "µm")
    if plain in ("", "pixel", "px", "none", "voxel", "unknown"):
        return None
    if plain not in _MM:
        raise ScanFileError(f"{path}: its unit of length {unit!r} isn't known; give --voxel-um")
    return _MM[plain]
