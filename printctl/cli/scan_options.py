"""Options that say what a scan's file doesn't."""

from __future__ import annotations

from printctl.cli.options import three_numbers


def voxel_mm(text: str | None) -> tuple[float, float, float] | None:
    """``X,Y,Z`` in µm to (dz, dy, dx) in mm."""
    if text is None:
        return None
    x, y, z = three_numbers(text, "--voxel-um")
    return (z * 1e-3, y * 1e-3, x * 1e-3)
