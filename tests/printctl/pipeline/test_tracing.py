"""Places at which a job's lines write."""

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.pipeline.judging.tracing import read_job


def test_lines_of_a_second_head_are_where_its_tip_writes(tmp_path):
    lines = ["T0 S1", "G1 X20 Y10 Z5 F600", "G1 X30 E1", "G92 E0", "T1 S1", "G1 X-20", "G1 X-10 E1"]
    (tmp_path / "part.gcode").write_text("\n".join(lines))
    source = np.where([" E" in line and "G1" in line for line in lines], 7, -1)
    np.savez(tmp_path / "map.npz", source=source, source_kind="vessel")
    job = read_job(
        tmp_path / "part.gcode",
        tmp_path / "map.npz",
        load(Printer, "two_syringe_marlin"),  # its second tip stands 40 mm aside in X
        np.array([0.0, 10.0, 5.0]),
        np.array([10.0, 10.0, 5.0]),
    )
    assert job.moves.line.tolist() == [3, 7]
    assert job.moves.start == pytest.approx(np.array([[10, 0, 0], [10, 0, 0]]))
    assert job.moves.end == pytest.approx(np.array([[20, 0, 0], [20, 0, 0]]))
    assert job.source.tolist() == [7, 7]
