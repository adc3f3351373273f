import asyncio
import json
import os
from pathlib import Path

import httpx
import numpy as np
import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st

from printctl.checks.gcode_view import LineMap, read_line_map
from printctl.web.live import JobSource, LiveScene, SceneError, make_scene
from printctl.web.live.routes import SceneMaker, router
from printctl.web.live.scene import ACT, NONE, VESSEL
from printctl.web.live.scene_worker import pack_scene, write_scene
from report.gcode import Act
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.web.live import jobs
from tests.printctl.web.live.jobs import moves_of, read_packed


def answers(
    sources: dict[str, JobSource], *asked: tuple[str, dict[str, str]]
) -> list[httpx.Response]:
    """Answers of an application that makes scenes in its own process."""

    async def ask() -> list[httpx.Response]:
        maker, app = SceneMaker(), FastAPI()
        app.include_router(router(sources.__getitem__, maker))
        try:
            async with httpx.AsyncClient(
                transport=httpx.ASGITransport(app), base_url="http://test"
            ) as client:
                return [await client.get(url, headers=headers) for url, headers in asked]
        finally:
            await maker.close()

    return asyncio.run(ask())


def test_moves_are_sent_once_and_then_known_by_their_tag(tmp_path: Path) -> None:
    source = jobs.source(tmp_path, jobs.squares(2))
    [first] = answers({"a": source}, ("/live/a/scene", {}))
    assert first.status_code == 200
    assert len(read_packed(first.content)[3]) > 20
    known = {"If-None-Match": f'"other", W/{first.headers["etag"]}'}
    other = {"If-None-Match": '"other"'}
    again, anew = answers({"a": source}, ("/live/a/scene", known), ("/live/a/scene", other))
    assert (again.status_code, again.content) == (304, b"")
    assert anew.content == first.content


def test_what_cannot_be_shown_is_said_and_the_next_job_is_made(tmp_path: Path) -> None:
    empty = jobs.source(tmp_path, b"; nothing\n")
    gone = JobSource(tmp_path / "gone.gcode", tmp_path / "cache")
    (tmp_path / "good").mkdir()
    good = jobs.source(tmp_path / "good", jobs.squares(1))
    nothing, missing, unknown, next_one = answers(
        {"empty": empty, "gone": gone, "good": good},
        ("/live/empty/scene", {}),
        ("/live/gone/scene", {}),
        ("/live/other/scene", {}),
        ("/live/good/scene", {}),
    )
    assert next_one.status_code == 200, "the process is ready for the next job"
    assert nothing.status_code == missing.status_code == 422
    assert "no move" in nothing.json()["detail"]
    assert "gone.gcode can't be read" in missing.json()["detail"]
    assert unknown.status_code == 404


def test_a_maker_that_died_begins_again(tmp_path: Path) -> None:
    async def die_and_ask() -> Path:
        maker = SceneMaker()
        await maker.start()
        process = maker.process
        assert process is not None
        process.kill()
        await process.wait()
        try:
            return await maker.scene_file(jobs.source(tmp_path, jobs.squares(1)))
        finally:
            await maker.close()

    assert asyncio.run(die_and_ask()).is_file()


@pytest.mark.skipif(not hasattr(os, "nice"), reason="no priorities")
def test_scenes_are_made_behind_a_print(tmp_path: Path) -> None:
    async def priority() -> int:
        maker = SceneMaker()
        try:
            await maker.scene_file(jobs.source(tmp_path, jobs.squares(1)))
            assert maker.process is not None
            return os.getpriority(os.PRIO_PROCESS, maker.process.pid)
        finally:
            await maker.close()

    assert asyncio.run(priority()) >= 10


def test_a_job_that_takes_too_long_is_given_up(tmp_path: Path) -> None:
    async def hurry() -> None:
        maker = SceneMaker(longest_s=1e-3)
        try:
            await maker.scene_file(jobs.source(tmp_path, jobs.squares(1)))
        finally:
            await maker.close()

    with pytest.raises(SceneError, match=r"wasn't made in 0\.001 s"):
        asyncio.run(hurry())


@pytest.mark.parametrize("name", ["live_view.js", "three.js", "live_view.css"])
def test_scripts_and_styles_come_with_type_and_tag(name: str) -> None:
    [found, escaped] = answers(
        {}, (f"/live/static/{name}", {}), ("/live/static/..%2F..%2Fscene.py", {})
    )
    assert found.status_code == 200
    assert found.headers["content-type"].startswith("text/")
    assert found.headers["x-content-type-options"] == "nosniff"
    assert found.headers["etag"]
    assert escaped.status_code == 404


# --- scene of a job: packed numbers against a plain reader
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
