import asyncio
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from printctl.web.live import JobSource, SceneError
from printctl.web.live.routes import SceneMaker, router
from tests.printctl.web.live import jobs
from tests.printctl.web.live.oracle import read_packed


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
        process = maker._process
        assert process is not None
        process.kill()
        await process.wait()
        try:
            return await maker.scene_file(jobs.source(tmp_path, jobs.squares(1)))
        finally:
            await maker.close()

    assert asyncio.run(die_and_ask()).is_file()


def test_while_a_print_goes_on_scenes_are_made_behind_it(tmp_path: Path) -> None:
    async def ask() -> tuple[Path, str]:
        maker = SceneMaker(lambda: True)
        asked: list[str] = []
        send = maker._ask

        async def noted(line: str) -> dict[str, str]:
            asked.append(line)
            return await send(line)

        maker._ask = noted  # type: ignore[method-assign]
        try:
            return await maker.scene_file(jobs.source(tmp_path, jobs.squares(1))), asked[0]
        finally:
            await maker.close()

    path, line = asyncio.run(ask())
    assert path.is_file()
    assert line.startswith("behind {")


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
