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


def test_faces_come_back_from_their_differences() -> None:
    faces = np.random.default_rng(1).integers(0, 90_000, (200, 3))
    assert running_sum(unpacked(pack_faces(faces), "<i4"), 2**32) == faces.ravel().tolist()


def test_surfaces_share_the_triangles_and_small_ones_stay_whole() -> None:
    surfaces = [deviation_surface(0.3), block_surface(), deviation_surface(0.4)]
    packed = pack_surfaces(surfaces, max_faces=3000)
    assert sum(p["face_count"] for p in packed) <= 3000
    assert packed[1]["face_count"] == 12
    assert packed[1]["cell_mm"] == 0.0
    assert packed[0]["cell_mm"] > 0.0
    assert packed[0]["full_face_count"] == len(surfaces[0].surface.faces)
