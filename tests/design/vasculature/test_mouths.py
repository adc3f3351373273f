import manifold3d
import numpy as np
import pytest

from design.errors import RootError
from design.geometry import build_triangle_tree, nearest_distances
from design.network import VesselKind, VesselNetwork
from design.tissue import tissue_from_surface
from design.vasculature import GrowthOptions, RootSpec, grow_forest, grow_tree
from design.vasculature.clipping import clip_ends
from design.vasculature.treemath import tree_radii


def box(*size):
    return manifold3d.Manifold.cube(size or (8.0, 6.0, 3.0))


def ball(*radii):
    return manifold3d.Manifold.sphere(1.0, 64).scale(radii)


def wedge():
    corners = [(0, 0, 0), (10, 0, 0), (0, 6, 0), (10, 6, 0), (0, 0, 5), (0, 6, 5)]
    return manifold3d.Manifold.hull_points(corners)


def tube():
    hole = manifold3d.Manifold.cylinder(20.0, 2.5, 2.5, 48, True)
    return manifold3d.Manifold.cylinder(6.0, 6.0, 6.0, 48) - hole


SHAPES = {
    "block": box,
    "flat face of many triangles": lambda: box().refine(12),
    "L": lambda: box() + box(4.0, 6.0, 8.0),
    "tilted block": lambda: box().rotate((0.0, 25.0, 10.0)),
    "wedge": wedge,
    "tube": tube,
    "ellipsoid": lambda: ball(5.0, 4.0, 3.0),
    "half ellipsoid": lambda: ball(6.0, 5.0, 4.0).trim_by_plane((0.0, 0.0, -1.0), 0.0),
    "plate": lambda: box(20.0, 15.0, 2.0),
}


def tissue_of(shape):
    mesh = shape.to_mesh()
    return tissue_from_surface(np.asarray(mesh.vert_properties[:, :3], float), mesh.tri_verts)


def sharp_edges(tissue, degrees=25.0):
    """Ends (n, 2, 3) of edges whose two faces turn by more."""
    vertices, faces = tissue.surface.vertices, np.asarray(tissue.surface.faces)
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sides = {}
    for face, own in enumerate(faces):
        for k in range(3):
            sides.setdefault(tuple(sorted((own[k], own[(k + 1) % 3]))), []).append(face)
    sharp = [
        edge
        for edge, (one, two) in sides.items()
        if normal[one] @ normal[two] < np.cos(np.radians(degrees))
    ]
    return vertices[np.array(sharp, dtype=int).reshape(-1, 2)]


def distance_to(edges, point):
    if not len(edges):
        return np.inf
    way = edges[:, 1] - edges[:, 0]
    t = np.einsum("ij,ij->i", point - edges[:, 0], way) / np.einsum("ij,ij->i", way, way)
    return np.linalg.norm(edges[:, 0] + np.clip(t, 0, 1)[:, None] * way - point, axis=1).min()


def least_wall(tree, tissue):
    """Of the trunk, past its mouth: as far in as the trunk and its wall are wide."""
    exact = build_triangle_tree(tissue.surface.vertices, tissue.surface.faces)
    radius, begin, end = tree_radii(tree)[0], tree.proximal[0], tree.distal[0]
    length = np.linalg.norm(end - begin)
    along = np.linspace(min(1.1 * (radius + 0.1), length), length, 50)
    axis = begin + along[:, None] * (end - begin) / length
    assert tissue.contains(axis).all()
    return nearest_distances(exact, axis).min() - radius


@pytest.mark.parametrize("name", SHAPES)
def test_default_root_lies_inside_a_face_and_its_trunk_keeps_its_wall(name):
    tissue = tissue_of(SHAPES[name]())
    options = GrowthOptions(terminals=6, smallest_radius_mm=0.2, clearance_mm=0.1)
    tree = grow_tree(tissue, options)
    need = tree_radii(tree)[0] + options.clearance_mm
    assert distance_to(sharp_edges(tissue), tree.proximal[0]) >= need
    assert least_wall(tree, tissue) >= options.clearance_mm - 1e-9
    assert tree.proximal[0, 2] > tissue.bounds.mean(axis=0)[2]
    assert tree.notes[0].startswith("root placed at (")


@pytest.mark.parametrize("name", ["block", "L", "tube"])
def test_default_roots_of_artery_and_vein_lie_inside_faces(name):
    tissue = tissue_of(SHAPES[name]())
    options = GrowthOptions(terminals=3, smallest_radius_mm=0.15, clearance_mm=0.1)
    trees = grow_forest(tissue, [RootSpec(options), RootSpec(options, VesselKind.VEIN)])
    edges = sharp_edges(tissue)
    for tree in trees:
        assert distance_to(edges, tree.proximal[0]) >= tree_radii(tree)[0] + 0.1
        assert least_wall(tree, tissue) >= 0.1 - 1e-9
    assert trees[1].notes[0].startswith("root of the vein placed at (")


def test_named_root_beside_an_edge_is_refused_with_place_wall_and_key():
    options = GrowthOptions(
        terminals=6, smallest_radius_mm=0.2, clearance_mm=0.1, root_point_mm=(4.0, 0.65, 3.0)
    )
    with pytest.raises(RootError, match=r"wall is [-\d.]+ mm thick at \(4, 0\.65, .*root_mm"):
        grow_tree(tissue_of(box()), options, attempts=1)


def test_root_at_top_is_the_highest_vertex_even_on_an_edge():
    tissue = tissue_of(box())
    tree = grow_tree(tissue, GrowthOptions(terminals=20, root_at_top=True))
    np.testing.assert_array_equal(tree.proximal[0], tissue.top_vertex()[0])


def channel(*points, radius=0.3):
    return VesselNetwork.from_segments(
        np.array(points, dtype=float),
        np.array([[k, k + 1] for k in range(len(points) - 1)]),
        np.full(len(points) - 1, radius),
        np.zeros(len(points) - 1, dtype=int),
        np.zeros(len(points) - 1, dtype=int),
    )


def test_channel_ends_beyond_the_faces_are_cut_off_there():
    network, cut = clip_ends(tissue_of(box()), channel((-0.5, 3, 1.5), (4, 3, 1.5), (9, 3, 1.5)))
    np.testing.assert_allclose(network.nodes[:, 0], [0, 4, 8], atol=1e-6)
    np.testing.assert_allclose([one.length_mm for one in cut], [0.5, 1.0], atol=1e-6)
    straight, _ = clip_ends(tissue_of(box()), channel((-0.5, 3, 1.5), (9, 3, 1.5)))
    np.testing.assert_allclose(straight.points[:, 0], [0, 8], atol=1e-6)


def test_channel_that_ends_at_the_faces_stays_as_it_is():
    network = channel((0, 3, 1.5), (8, 3, 1.5))
    assert clip_ends(tissue_of(box()), network) == (network, ())
