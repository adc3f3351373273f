"""Read the mesh files of one part, a print head for each, into one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.solids import Solid, read_solid
from design.solids.manifolds import solid_manifold
from design.toolpath.fresh import Filling, Region
from design.units import LengthUnit
from firmware_profiles import Printer
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.pipeline.slicing.modifiers import Modifier


@dataclass(frozen=True)
class Assembly:
    """Meshes in one frame, and the places among them that are written in another way.

    Attributes
    ----------
    solids : tuple of Solid
    heads : tuple of int
        Which head writes each.
    regions : tuple of Region
        Where two overlap, the last counts: the later mesh, and any modifier.
    """

    solids: tuple[Solid, ...]
    heads: tuple[int, ...]
    regions: tuple[Region, ...]

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of all meshes, (2, 3), mm."""
        corners = np.array([solid.bounds for solid in self.solids])
        return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def assemble(
    models: Sequence[Path],
    heads: Sequence[int],
    modifiers: Sequence[Modifier],
    filling: Filling,
    unit: LengthUnit | None,
) -> Assembly:
    """Read the meshes and modifiers of a part.

    Parameters
    ----------
    models : sequence of Path
        Their coordinates are in one frame, as a CAD program exports the bodies of an assembly.
    heads : sequence of int
        Of each model.
    modifiers : sequence of Modifier
    filling : Filling
        Of all that no modifier is in.
    unit : "um", "mm", "cm", "m" or "in"
        Of all files; None where each says it itself.

    Raises
    ------
    UsageError
        For a modifier that lies outside of all models.
    SolidError
        For a mesh that can't be read or isn't closed.
    """
    solids = tuple(read_solid(model, unit, for_sections=True) for model in models)
    # With one mesh of head 0 there is nothing to part.
    parted = [] if set(heads) == {0} else zip(solids, heads, strict=True)
    regions = [Region(solid, filling, head) for solid, head in parted]
    bodies = None
    for modifier in modifiers:
        own = read_solid(modifier.path, unit)
        bodies = bodies or [
            solid_manifold(*pair) for pair in zip(solids, map(str, models), strict=True)
        ]
        place = solid_manifold(own, str(modifier.path))
        if all((body ^ place).is_empty() for body in bodies):
            raise UsageError(
                f"--modifier {modifier.path} lies outside of the part ({_span(own)}; the part "
                f"{_span(*solids)}), so it would change nothing; export it in the part's frame "
                "and unit"
            )
        regions.append(Region(own, modifier.filling(filling), modifier.head))
    return Assembly(solids, tuple(heads), tuple(regions))


def head_of_each(text: str | None, models: int, printer: Printer) -> list[int]:
    """Head of each mesh: as said (``0,1,1``), else one after the other.

    Raises
    ------
    UsageError
        For another number of heads than of meshes, or a head that the printer hasn't.
    """
    count = printer.head_count
    if text is None:
        if count > 1 and models > count:
            raise UsageError(
                f"{models} meshes for the {count} heads of {printer.name}; say which head writes "
                f"each with --heads, like --heads {','.join(str(k % count) for k in range(models))}"
            )
        return [k if count > 1 else 0 for k in range(models)]
    try:
        heads = [int(word) for word in text.split(",")]
    except ValueError as exc:
        raise UsageError(
            f"--heads {text!r} isn't a list of numbers; write one for each mesh, like 0,1"
        ) from exc
    if len(heads) != models:
        raise UsageError(f"--heads {text!r} names {len(heads)}, for {models} meshes; one for each")
    for head in heads:
        if not 0 <= head < count:
            raise UsageError(
                f"--heads {text!r}: {printer.name} has no head {head}, only 0 to {count - 1}; "
                "name one of them, or choose another --printer"
            )
    return heads


def _span(*solids: Solid) -> str:
    corners = np.array([solid.bounds for solid in solids])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    words = (f"{a} {x:g} to {y:g}" for a, x, y in zip("xyz", low, high, strict=True))
    return f"{', '.join(words)} mm"
