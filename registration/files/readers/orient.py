"""Reorder a scan file's axes to z, y, x and make them right-handed; check sizes for swaps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from registration.errors import ScanFileError
from registration.files.readers.raw_result import Array

ORDER = "zyx"


def to_scan_axes(volume: Array, axes: str, path: Path) -> Array:
    """A view with the axes z, y, x, from a volume whose axes are named slowest to fastest.

    Raises
    ------
    ScanFileError
        When `axes` isn't an order of x, y, z.
    """
    named = axes.lower()
    if not is_axes(axes):
        raise ScanFileError(
            f"{path}: axes are {axes!r}; give an order of x, y and z, slowest first, like zyx for "
            "a stack of depth slices or yxz where depth runs fastest; give --axes"
        )
    return volume.transpose([named.index(name) for name in ORDER])


def rename_axes(sizes: Sequence[float], old: str, new: str) -> list[float]:
    """Sizes along z, y, x of a file's axes that are called otherwise from now on."""
    by_new = {
        after: sizes[ORDER.index(before)]
        for before, after in zip(old.lower(), new.lower(), strict=True)
    }
    return [by_new[name] for name in ORDER]


def is_axes(axes: object) -> bool:
    """Whether something is an order of x, y and z."""
    return isinstance(axes, str) and sorted(axes.lower()) == sorted(ORDER)


def unmirrored(volume: Array) -> Array:
    """The same voxels with y reversed: a left-handed order of axes becomes right-handed."""
    return volume[:, ::-1, :]


def check_aspect(
    shape: Sequence[int], voxel: Sequence[float], extent: Sequence[float], path: Path
) -> None:
    """Hold sizes against the extent that the file gives apart from them; all as z, y, x in mm.

    Raises
    ------
    ScanFileError
        When they contradict each other; the message says if axes were swapped.
    """
    sizes = [count * step for count, step in zip(shape, voxel, strict=True)]
    if _agree(shape, voxel, extent):
        return
    for first, second in ((1, 2), (0, 2), (0, 1)):
        swapped = list(voxel)
        swapped[first], swapped[second] = swapped[second], swapped[first]
        if _agree(shape, swapped, extent):
            raise ScanFileError(
                f"{path}: axes {ORDER[first]} and {ORDER[second]} are swapped: voxels of "
                f"{_mm(voxel)} mm make {_mm(sizes)} mm, but the field is said to be "
                f"{_mm(extent)} mm (z, y, x); export it again, or give --voxel-um"
            )
    raise ScanFileError(
        f"{path}: voxels of {_mm(voxel)} mm make {_mm(sizes)} mm, but the field is said to be "
        f"{_mm(extent)} mm (z, y, x); the header contradicts itself, give --voxel-um"
    )


def _agree(shape: Sequence[int], voxel: Sequence[float], extent: Sequence[float]) -> bool:
    # Some programs count the steps between voxels, others the voxels: one voxel is forgiven.
    return all(
        abs(count * step - size) <= max(0.02 * size, 1.01 * step)
        for count, step, size in zip(shape, voxel, extent, strict=True)
    )


def _mm(values: Sequence[float]) -> str:
    return " × ".join(f"{value:.4g}" for value in values)
