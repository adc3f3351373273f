"""Build a dish insert as two flush bodies: the white plate, and the black of its marks."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold, OpType

from design.solids.solid import Solid
from registration.devices.camera_frame.insert import Insert
from registration.errors import PictureError

_JOIN_MM: Final = 0.005
"""Cells are wider by it on each side: those that meet at a corner alone are joined."""
_FACETS: Final = 256


def insert_solids(insert: Insert, black_mm: float = 0.6) -> tuple[Solid, Solid]:
    """Return the white plate with pockets, and the black that fills them; z = 0 is below.

    Both end at the same height. A relief would shift its edges in a picture taken from aside: by
    its height times the tangent of the angle.

    Parameters
    ----------
    insert : Insert
    black_mm : float, mm
        Depth of the pockets.

    Raises
    ------
    PictureError
        When the pockets would go through the plate.
    """
    thick = insert.thickness_mm
    if not 0 < black_mm < thick - 0.2:
        raise PictureError(
            f"black of {black_mm:g} mm leaves less than 0.2 mm of a plate of {thick:g} mm; give a "
            "thickness of 1 mm or more"
        )
    wide, high = insert.plate_mm
    plate = _rectangle(-wide / 2, -high / 2, wide, high) - _hole(insert)
    side = insert.cell_mm + 2 * _JOIN_MM
    cells = [_rectangle(x - _JOIN_MM, y - _JOIN_MM, side, side) for x, y in insert.cells().tolist()]
    bars = [_rectangle(*bar) for bar in insert.bars()]
    black = CrossSection.batch_boolean(cells + bars, OpType.Add)
    inlay = Manifold.extrude(black, black_mm).translate((0.0, 0.0, thick - black_mm))
    tall = Manifold.extrude(black, black_mm + 1.0).translate((0.0, 0.0, thick - black_mm))
    body = Manifold.extrude(plate, thick) - tall
    return _solid(body), _solid(inlay)


def _rectangle(x: float, y: float, wide: float, high: float) -> CrossSection:
    corners = np.array([[x, y], [x + wide, y], [x + wide, y + high], [x, y + high]])
    return CrossSection([corners], FillRule.Positive)


def _hole(insert: Insert) -> CrossSection:
    x, y = insert.hole_mm
    if insert.shape == "round":
        return CrossSection.circle(x / 2, _FACETS)
    return _rectangle(-x / 2, -y / 2, x, y)


def _solid(body: Manifold) -> Solid:
    mesh = body.to_mesh64()
    vertices = np.asarray(mesh.vert_properties)[:, :3].astype(np.float32).astype(np.float64)
    return Solid(vertices, np.asarray(mesh.tri_verts, dtype=np.int32))
