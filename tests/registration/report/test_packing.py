import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from registration.report.packing import (
    level_column,
    pack_surface,
    pack_surfaces,
    pack_table,
)

from .columns import unpacked_table
from .sample import block_surface, deviation_surface

finite = st.floats(-1e6, 1e6)


@given(hnp.arrays(np.float64, st.integers(1, 30), elements=finite), st.booleans())
def test_levels_come_back_within_half_a_step(values: NDArray[np.float64], summed: bool) -> None:
    column = level_column("a", values, summed)
    back = unpacked_table(pack_table([column], {"a": values}))["a"]
    assert (np.abs(back - values) <= 0.5001 * column.step + 1e-9).all()


def test_values_that_arent_finite_come_back_as_none() -> None:
    for values in (np.array([np.nan, 2.0, np.inf, 5.0]), np.full(4, np.nan)):
        back = unpacked_table(pack_table([level_column("a", values)], {"a": values}))["a"]
        assert np.isnan(back).tolist() == (~np.isfinite(values)).tolist()
        assert back[np.isfinite(values)] == pytest.approx(values[np.isfinite(values)])


def test_a_packed_surface_comes_back() -> None:
    surface = deviation_surface(0.5)
    packed = pack_surface(surface, 10**6)
    points = unpacked_table(packed["points"])
    for k, column in enumerate(packed["points"]["columns"]):
        back = points["xyz"[k]]
        assert np.abs(back - surface.surface.vertices[:, k]).max() <= 0.51 * column["step"]
        assert column["step"] < 0.001
    faces = unpacked_table(packed["corners"])["vertex"]
    assert faces.tolist() == surface.surface.faces.ravel().tolist()
    scalar = unpacked_table(packed["scalar"])["value"]
    np.testing.assert_allclose(scalar, surface.scalar, atol=0.01)


def test_surfaces_share_the_triangles_and_small_ones_stay_whole() -> None:
    surfaces = [deviation_surface(0.3), block_surface(), deviation_surface(0.4)]
    packed = pack_surfaces(surfaces, max_faces=3000)
    assert sum(p["face_count"] for p in packed) <= 3000
    assert packed[1]["face_count"] == 12
    assert packed[1]["cell_mm"] == 0.0
    assert packed[0]["cell_mm"] > 0.0
    assert packed[0]["full_face_count"] == len(surfaces[0].surface.faces)
