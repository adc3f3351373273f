import numpy as np
import pytest
from numpy.typing import NDArray

from design.geometry.surface import Surface
from registration.report import ReportSurface
from registration.report.simplify import (
    cluster_vertices,
    distinct_faces,
    mean_per_cluster,
    simplify,
)

from .sample import block_surface, deviation_surface


def volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def naive_means(values: NDArray[np.float64], cluster: NDArray[np.int64]) -> list[float]:
    groups: dict[int, list[float]] = {}
    for number, value in zip(cluster.tolist(), values.tolist(), strict=True):
        groups.setdefault(number, []).append(value)
    return [
        float(np.mean(known)) if (known := [v for v in groups[n] if v == v]) else float("nan")
        for n in sorted(groups)
    ]


def test_a_small_surface_stays_as_it_is() -> None:
    block = block_surface()
    shown = simplify(block, 12)
    assert shown.cell_mm == 0.0
    np.testing.assert_array_equal(shown.surface.vertices, block.surface.vertices)
    np.testing.assert_array_equal(shown.surface.faces, block.surface.faces)


@pytest.mark.parametrize("max_faces", [4000, 1500, 300, 100])
def test_no_more_triangles_than_asked_for(max_faces: int) -> None:
    shown = simplify(deviation_surface(0.2), max_faces)
    assert 0 < len(shown.surface.faces) <= max_faces


def test_shape_and_values_are_kept_to_the_cell() -> None:
    surface = deviation_surface(0.1)
    shown = simplify(surface, len(surface.surface.faces) // 3)
    before, after = (volume(s.surface.vertices, s.surface.faces) for s in (surface, shown))
    assert before > 0
    # The mean of points on a curved wall lies a little inside it.
    assert after == pytest.approx(before, rel=0.05)
    far = shown.cell_mm * np.sqrt(3.0)
    for k in range(0, len(shown.surface.vertices), 97):
        near = np.linalg.norm(surface.surface.vertices - shown.surface.vertices[k], axis=1)
        assert near.min() < far
    assert shown.scalar is not None
    assert np.nanmax(shown.scalar) <= np.nanmax(surface.scalar)  # type: ignore[arg-type]


def test_a_flat_line_of_triangles_doesnt_loop_for_ever() -> None:
    count = 400
    vertices = np.zeros((count, 3))
    vertices[:, 0] = np.arange(count)
    first = np.arange(count - 2)
    faces = np.stack([first, first + 1, first + 2], axis=1)
    assert len(simplify(ReportSurface("line", Surface(vertices, faces)), 50).surface.faces) <= 50


def test_vertices_of_a_cluster_share_a_cell() -> None:
    points = np.random.default_rng(2).uniform(-3, 5, (500, 3))
    cluster, count = cluster_vertices(points, 0.7)
    assert sorted(set(cluster.tolist())) == list(range(count))
    for number in range(count):
        assert (np.ptp(points[cluster == number], axis=0) <= 0.7).all()


def test_means_leave_out_missing_values() -> None:
    random = np.random.default_rng(3)
    cluster = np.concatenate([np.arange(9), random.integers(0, 9, 60)])
    values = random.normal(size=69)
    values[random.random(69) < 0.3] = np.nan
    values[cluster == 4] = np.nan
    got = mean_per_cluster(values[:, None], cluster, 9)[:, 0]
    np.testing.assert_allclose(got, naive_means(values, cluster))


def test_turned_faces_are_the_same_face_and_mirrored_ones_arent() -> None:
    faces = np.array([[5, 2, 9], [2, 9, 5], [9, 2, 5], [1, 2, 3]])
    assert distinct_faces(faces).tolist() == [[2, 9, 5], [2, 5, 9], [1, 2, 3]]
