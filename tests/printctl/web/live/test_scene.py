import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.checks.gcode_view import LineMap, read_line_map
from printctl.web.live import LiveScene, SceneError, make_scene
from printctl.web.live.scene import ACT, NONE, VESSEL
from printctl.web.live.scene_worker import pack_scene, write_scene
from registration.report.gcode import Act
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.web.live import jobs
from tests.printctl.web.live.oracle import moves_of, read_packed


def scene_of(folder: Path, gcode: bytes, line_map: LineMap | None = None) -> LiveScene:
    return make_scene(jobs.source(folder, gcode), gcode, line_map)


def test_packed_numbers_are_those_of_a_plain_reader(tmp_path: Path) -> None:
    gcode = jobs.squares(4)
    header, points, commands, times = read_packed(pack_scene(scene_of(tmp_path, gcode)))
    about = json.loads(header)
    expected = moves_of(gcode)
    assert about["moves"] == len(expected) == len(commands)
    assert commands == [move.command for move in expected]
    for point, move in zip(points[1:], expected, strict=True):
        for axis in range(3):
            mm = about["low_mm"][axis] + about["step_mm"][axis] * point[axis]
            assert mm == pytest.approx(move.end[axis], abs=0.51 * about["step_mm"][axis])
        assert (point[ACT] == Act.WRITE) == move.writes
    assert times == sorted(times)
    assert times[-1] == pytest.approx(about["duration_s"], rel=1e-6)
    assert about["layers"] == pytest.approx([0.2, 0.4, 0.6, 0.8])


LINES = st.sampled_from(
    [b"G1 X%d Y1 E%d", b"; c", b"", b"(c)", b"M400", b"G4 P1", b"  ", b"G0 Z%d.5"] + [b"M105 (c)"]
)


@given(st.lists(LINES, max_size=30), st.sampled_from([b"\n", b"\r\n", b"\r"]))
def test_commands_agree_with_the_link_whatever_stands_between(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], end: bytes
) -> None:
    filled = [raw.replace(b"%d", b"%d" % k) for k, raw in enumerate(lines, start=2)]
    head = jobs.HEAD.split(b"\n")
    gcode = end.join([*head, b"G1 X1 Y1 E1", *filled, b"G1 X99 Y9 E99"]) + end
    scene = scene_of(tmp_path_factory.mktemp("job"), gcode)
    job = parse_job(gcode, "job.gcode")
    assert scene.about["commands"] == len(job)
    assert {job.lines[k][:2] for k in scene.command.tolist()} <= {b"G0", b"G1"}
    assert scene.command[-1] == len(job) - 1


def test_vessels_come_from_the_map_beside_the_file(tmp_path: Path) -> None:
    gcode = jobs.squares(2)
    lines = gcode.count(b"\n")
    of = np.where(np.arange(lines) < lines // 2, 3, -1)
    np.savez(tmp_path / "job.map.npz", source=of, source_kind="vessel")
    line_map, _ = read_line_map(tmp_path / "job.gcode", lines)
    scene = scene_of(tmp_path, gcode, line_map)
    assert set(scene.points[1:, VESSEL].tolist()) == {3, NONE}
    assert scene.about["vessels"] == 1
    assert scene.about["passes"]


@pytest.mark.parametrize(
    ("gcode", "said"),
    [
        (b"", "no move"),
        (b"; only words\n", "no move"),
        (jobs.HEAD + b"G1 X5 F600\nG1 Y5\n", "none of its 2 moves writes"),
        (b"\0\1\2\3", "binary"),
        (b"M105\n<script>alert(1)</script>\n", "isn't a command"),
        (b"G2 X\n<script>alert(1)</script>\n", "line 1: 'G2 X': X has no number"),
        (jobs.HEAD + b"G1 Xnan E1\nG1 X1e400 E2\nG1 X5 E3\n", "line 5.*Xnan.*2 lines"),
    ],
)
def test_a_file_that_cannot_be_shown_says_why(tmp_path: Path, gcode: bytes, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        write_scene(jobs.source(tmp_path, gcode))
    assert not list((tmp_path / "cache").glob("*"))
