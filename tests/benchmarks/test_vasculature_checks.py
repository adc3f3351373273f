import numpy as np
import pytest

from benchmarks.checkers import Perfusion, box_triangles, consistent_radii, write_stl
from benchmarks.vasculature.checks import DROP_PA, VISCOSITY_PA_S, check, rows_of
from tests.benchmarks.checkers.nets import net_of

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
POINTS = [[5.0, 5, 10], [5, 5, 8], [2, 5, 5], [8, 5, 5], [2, 2, 2], [2, 8, 2], [8, 2, 2], [8, 8, 2]]
EDGES = [[0, 1], [1, 2], [1, 3], [2, 4], [2, 5], [3, 6], [3, 7]]


def written(folder, points, radius=None):
    """A file with the given radii or, by default, those that feed all outlets alike."""
    net = net_of(points, EDGES, 0.1)
    if radius is None:
        radius = consistent_radii(net, Perfusion(10.0, DROP_PA, VISCOSITY_PA_S))
    rows = [HEADER]
    for k, (a, b) in enumerate(EDGES):
        numbers = [*map(float, points[a]), *map(float, points[b]), float(radius[k])]
        rows.append(",".join(map(repr, [k, a, b, *numbers, float(radius[k])])) + ",artery,0")
    write_stl(folder / "box.stl", box_triangles(np.zeros(3), np.full(3, 10.0)))
    (folder / "network.csv").write_text("\n".join(rows) + "\n")
    return check(folder / "network.csv", folder / "box.stl", 10.0)


def broken(found):
    """The measures whose goal isn't met."""
    return [
        row["measure"].removeprefix("here: ")
        for row in rows_of("here", 4, found)
        if row.get("met") is False
    ]


def test_a_sound_file_meets_every_goal(tmp_path):
    found = written(tmp_path, POINTS)
    assert broken(found) == []
    assert found.inflow_ul_s == pytest.approx(10.0, rel=1e-12)


def test_a_wrong_radius_is_seen_by_flow_murray_and_ratios(tmp_path):
    net = net_of(POINTS, EDGES, 0.1)
    radius = consistent_radii(net, Perfusion(10.0, DROP_PA, VISCOSITY_PA_S))
    radius[4] *= 1.01
    assert broken(written(tmp_path, POINTS, radius)) == [
        "terminal flow spread",
        "Murray residual",
        "radii against consistent ones",
    ]


@pytest.mark.parametrize(
    ("moved", "goal", "places"),
    [
        ({4: [8, 2, 3.5], 6: [2, 2, 3.52]}, "colliding pairs", ([[3, 5]], [])),
        ({7: [8, 8, -1]}, "segments out of tissue", ([], [6])),
    ],
)
def test_a_planted_collision_and_a_piece_outside_are_seen(tmp_path, moved, goal, places):
    found = written(tmp_path, [moved.get(k, point) for k, point in enumerate(POINTS)])
    assert broken(found) == [goal]
    assert (found.first_colliding, found.first_outside) == places
