import base64
import zlib

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from registration.report.packing import (
    NO_DATA,
    pack_faces,
    pack_surface,
    pack_surfaces,
    quantise,
)

from .sample import block_surface, deviation_surface


def unpacked(text: str, dtype: str) -> NDArray[np.generic]:
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype)


def running_sum(differences: NDArray[np.generic], modulus: int) -> list[int]:
    """What the page does, in plain Python: each entry is the one before plus its difference."""
    result, value = [], 0
    for difference in differences.tolist():
        value = (value + difference) % modulus
        result.append(value)
    return result


finite = st.floats(-1e6, 1e6)


@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=finite))
def test_quantised_values_come_back_within_half_a_step(values: NDArray[np.float64]) -> None:
    levels, low, step = quantise(values)
    back = np.array(low) + np.array(step) * levels
    assert (levels != NO_DATA).all()
    assert (np.abs(back - values) <= 0.5001 * np.array(step) + 1e-9).all()


def test_values_that_arent_finite_are_marked() -> None:
    levels, low, _ = quantise(np.array([[np.nan], [2.0], [np.inf], [5.0]]))
    assert (levels[:, 0] == NO_DATA).tolist() == [True, False, True, False]
    assert low == [2.0]


def test_a_column_without_any_value_is_all_marked() -> None:
    levels, _, step = quantise(np.full((4, 1), np.nan))
    assert (levels == NO_DATA).all()
    assert step == [1.0]


def test_faces_come_back_from_their_differences() -> None:
    faces = np.random.default_rng(1).integers(0, 90_000, (200, 3))
    assert running_sum(unpacked(pack_faces(faces), "<i4"), 2**32) == faces.ravel().tolist()


def test_packed_positions_come_back() -> None:
    surface = deviation_surface(0.5)
    packed = pack_surface(surface, 10**6)
    steps = unpacked(packed["positions"], "<u2").reshape(-1, 3)
    for k in range(3):
        levels = np.array(running_sum(steps[:, k], 2**16))
        back = packed["low"][k] + packed["step"][k] * levels
        assert np.abs(back - surface.surface.vertices[:, k]).max() <= 0.51 * packed["step"][k]
    assert packed["step"][0] < 0.001


def test_surfaces_share_the_triangles_and_small_ones_stay_whole() -> None:
    surfaces = [deviation_surface(0.3), block_surface(), deviation_surface(0.4)]
    packed = pack_surfaces(surfaces, max_faces=3000)
    assert sum(p["face_count"] for p in packed) <= 3000
    assert packed[1]["face_count"] == 12
    assert packed[1]["cell_mm"] == 0.0
    assert packed[0]["cell_mm"] > 0.0
    assert packed[0]["full_face_count"] == len(surfaces[0].surface.faces)
