import numpy as np
import pytest

from benchmarks.checkers import box_triangles, enclosed_volume, read_stl, write_stl


def test_a_box_encloses_its_volume_and_reads_back():
    box = box_triangles(np.array([1.0, 2, 3]), np.array([2.0, 4, 7]))
    assert enclosed_volume(box) == pytest.approx(8.0)


def test_what_is_wound_inward_is_turned(tmp_path):
    box = box_triangles(np.zeros(3), np.ones(3))
    write_stl(tmp_path / "box.stl", box[:, ::-1])
    assert np.array_equal(read_stl(tmp_path / "box.stl"), box)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    with pytest.raises(ValueError, match="binary STL"):
        read_stl(tmp_path / "a.stl")
