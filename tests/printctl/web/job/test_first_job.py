"""Scene of the first shown job, prepared in advance."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from printctl.web.core import Core
from printctl.web.job import first_job
from printctl.web.job.service import JobService
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.live import jobs
from tests.slower import first_rows

SQUARES = jobs.squares(1)


@pytest.mark.parametrize(
    ("largest", "content", "made"),
    first_rows(
        [
            (len(SQUARES), SQUARES, 1),
            (len(SQUARES) - 1, SQUARES, 0),
            (100, None, 0),
            (100, b"\0", 0),
        ],
        3,
    ),
)
def test_it_is_made_unless_it_is_very_large(
    largest: int, content: bytes | None, made: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_job, "_FOUND_S", 0.0)
    monkeypatch.setattr(first_job, "_LARGEST_BYTES", largest)
    settings = ServeSettings(workspace=tmp_path)
    service = JobService(Core(settings, Workspace(tmp_path).make()))
    if content is not None:
        (tmp_path / "jobs" / "a.gcode").write_bytes(content)

    async def run() -> None:
        try:
            await first_job.make_first_scene(service)
        finally:
            await service.scenes.close()

    try:
        asyncio.run(run())
    finally:
        service.close()
    assert len(list(tmp_path.rglob("*.scene"))) == made
