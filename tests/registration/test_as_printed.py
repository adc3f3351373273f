"""Prints that ended early or whose layers were shifted, told from the scanned surface."""

from contextlib import suppress

import manifold3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import Alignment, AlignmentOptions, align
from registration.alignment.as_printed import AsPrinted, Misfit
from registration.alignment.distance import ModelSurface
from registration.errors import AlignmentError
from registration.segmentation.volume import GelField
from tests.registration.parts import solid
from tests.registration.test_alignment import surface_points

SIZE = (7.0, 5.0, 3.0)
FAST = AlignmentOptions(coarse_points=700, fine_points=5000, contest_points=20_000)
TURN = Rotation.from_euler("xyz", [3.0, 176.0, 40.0], degrees=True)
VOXEL_MM = 0.1


def part() -> manifold3d.Manifold:
    """A block with one channel along x and one along y, neither in the middle."""
    along_x = manifold3d.Manifold.cylinder(9.0, 0.3).rotate((0.0, 90.0, 0.0))
    along_y = manifold3d.Manifold.cylinder(7.0, 0.25).rotate((-90.0, 0.0, 0.0))
    block = manifold3d.Manifold.cube(SIZE)
    return block - along_x.translate((-1.0, 1.6, 1.0)) - along_y.translate((5.0, -1.0, 2.1))


def printed(ends_mm: float = 9.0, from_mm: float = 9.0, shift: float = 0.0) -> Solid:
    """The part up to a height, and shifted along x from another on."""
    whole = part().trim_by_plane((0.0, 0.0, -1.0), -ends_mm)
    above, below = whole.split_by_plane((0.0, 0.0, 1.0), from_mm)
    return solid(below + above.translate((shift, 0.0, 0.0)))


def explained(made: Solid) -> AsPrinted | None:
    """What is made of a scan of that print, held against the whole part."""
    model = solid(part())
    points = TURN.apply(surface_points(made, 30_000, 3)) + [2.0, -1.0, 5.0]
    size = np.ptp(made.vertices, axis=0)
    gel = manifold3d.Manifold(
        manifold3d.Mesh(made.vertices.astype(np.float32), made.faces.astype(np.uint32))
    ).volume()
    count = round(gel / VOXEL_MM**3)
    values = np.zeros(int(np.prod(size) / VOXEL_MM**3) + count, np.float32)
    values[:count] = 1.0
    field = GelField(values.reshape(1, 1, -1), 0.5, 1.0, np.full(3, VOXEL_MM), np.zeros(3), 0.0)

    def posed(surface: ModelSurface) -> Alignment:
        return align(surface, points, True, FAST)

    surface = ModelSurface.of(model)
    plain: Alignment | None = None
    with suppress(AlignmentError):
        plain = posed(surface)
    found = Misfit(model, surface, points, field, False, posed, FAST).explained(plain)
    return None if found is None else found.printed


def test_a_sound_print_needs_no_explanation() -> None:
    assert explained(printed()) is None


@pytest.mark.parametrize("ends_mm", [1.5, 2.6])
def test_a_print_that_ended_early_ends_where_its_top_is(ends_mm: float) -> None:
    found = explained(printed(ends_mm=ends_mm))
    assert found is not None
    assert found.ends_mm == pytest.approx(ends_mm, abs=0.02)
    assert found.missing_mm == pytest.approx(SIZE[2] - ends_mm, abs=0.02)
    assert found.shift is None


@pytest.mark.parametrize(("from_mm", "shift"), [(1.5, 0.4), (0.8, -0.25)])
def test_shifted_layers_are_found_with_their_height(from_mm: float, shift: float) -> None:
    found = explained(printed(from_mm=from_mm, shift=shift))
    assert found is not None
    assert found.shift is not None
    assert found.ends_mm is None
    assert found.shift.from_mm == pytest.approx(from_mm, abs=0.05)
    assert np.isinf(found.shift.to_mm)
    expected: FloatArray = np.array([shift, 0.0])
    np.testing.assert_allclose(found.shift.shift_mm, expected, atol=0.01)
