"""Choose the job that the Job page shows first, and prepare its 3D scene in advance."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Final

from printctl.web.errors import WebError
from printctl.web.job.service import JobService
from printctl.web.live import SceneError

_FOUND_S: Final = 3.0
"""So long after its start a server knows the print that goes on, which scenes are made behind."""
_LARGEST_BYTES: Final = 100_000_000
"""Two million moves: about two seconds."""


def first_job(service: JobService, asked: str = "") -> str:
    """The job that is asked for, else of the print that goes on or broke off, else the newest."""
    if asked:
        try:
            return service.job(asked).id
        except WebError:
            pass
    current = service.current() or service.unfinished()
    if current is not None:
        return current.job
    return next((one.id for one in service.jobs()), "")


async def make_scene(service: JobService, job: str) -> None:
    """Have the scene of a job made; what is wrong with it is told when the view asks for it."""
    with contextlib.suppress(KeyError, SceneError):
        await service.scenes.scene_file(await asyncio.to_thread(service.scene, job))


async def make_first_scene(service: JobService) -> None:
    """Have that of the job made which the page will show first, while nobody waits for it yet.

    Scenes are made one at a time: that of a very large job is left until somebody wants it.
    """
    await asyncio.sleep(_FOUND_S)
    with contextlib.suppress(OSError, WebError):  # it went away meanwhile
        job = await asyncio.to_thread(first_job, service)
        if job and (await asyncio.to_thread(service.job, job)).size <= _LARGEST_BYTES:
            await make_scene(service, job)
