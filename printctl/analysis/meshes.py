"""Read mesh files that the command line names."""

from __future__ import annotations

from pathlib import Path

from design.solids import Solid, read_solid
from design.solids.files.read import MESHES_WITHOUT_UNIT
from design.units import MM_PER, LengthUnit
from printctl.errors import UsageError


def read_model(
    path: Path,
    unit: LengthUnit | None,
    *,
    option: str = "--unit",
    for_sections: bool = False,
) -> Solid:
    """Read a mesh that the command line names, in mm.

    Raises
    ------
    UsageError
        No unit of a file that holds none.
    SolidError, OSError
        As `read_solid`.
    """
    if unit is None and path.suffix.lower() in MESHES_WITHOUT_UNIT:
        raise unit_missing(path, option)
    return read_solid(path, unit, for_sections=for_sections)


def unit_missing(path: Path, option: str) -> UsageError:
    """Return the refusal of a file whose unit isn't given; ``option`` takes it."""
    return UsageError(
        f"{path} doesn't say the unit of its coordinates; give {option}, one of {', '.join(MM_PER)}"
    )
