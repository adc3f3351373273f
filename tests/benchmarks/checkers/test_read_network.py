import numpy as np
import pytest

from benchmarks.checkers import read_network

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"


def test_columns_are_found_by_name_and_nodes_numbered_without_gaps(tmp_path):
    path = tmp_path / "network.csv"
    path.write_text(
        "tree,vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind\n"
        "3,0,70,9,0,0,0,1,0,0,0.25,0.5,vein\n"
        "3,1,9,500,1,0,0,1,2,0,0.1,0.1,vein\n"
    )
    net = read_network(path)
    assert net.node.tolist() == [[1, 0], [0, 2]]
    assert net.length.tolist() == [1.0, 2.0]
    assert net.radius.tolist() == [[0.25, 0.5], [0.1, 0.1]]
    assert net.kind.tolist() == ["vein", "vein"]
    assert net.tree.tolist() == [3, 3]
    assert net.inlets().tolist() == [1]
    assert net.outlets().tolist() == [2]


def test_numbers_keep_all_their_bits(tmp_path):
    values = np.random.default_rng(1).uniform(0.1, 1.0, 8)
    row = ",".join(repr(float(v)) for v in values)
    (tmp_path / "n.csv").write_text(f"{HEADER}0,0,1,{row},artery,0\n")
    net = read_network(tmp_path / "n.csv")
    assert np.concatenate([net.start[0], net.end[0], net.radius[0]]).tolist() == values.tolist()


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("0,0,1,0,0,0,1,0,0,0.1,0.1,artery,0\n1,1,2,1,0,0.1,2,0,0,0.1,0.1,artery,0\n", "apart"),
        ("0,0,1,0,0,0,1,0,0,0.1,0,artery,0\n", "above 0"),
        ("0,0,1,0,0,nan,1,0,0,0.1,0.1,artery,0\n", "NaN"),
    ],
)
def test_what_is_no_network_is_refused(tmp_path, rows, says):
    (tmp_path / "n.csv").write_text(HEADER + rows)
    with pytest.raises(ValueError, match=says):
        read_network(tmp_path / "n.csv")


def test_a_missing_column_is_named(tmp_path):
    (tmp_path / "n.csv").write_text("vessel,node0\n0,1\n")
    with pytest.raises(ValueError, match="radius0_mm"):
        read_network(tmp_path / "n.csv")
