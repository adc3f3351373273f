"""Start the process that makes live-view scenes, and ask it for a job's scene file."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from printctl.web.live.errors import SceneError
from printctl.web.live.scene_store import cached_scene
from printctl.web.live.source import JobSource
from printctl.web.low_priority import BEHIND, NOW

_LONGEST_S: Final = 120.0
"""For a job of 50 million moves."""

# Arrays of a large job come and go by the dozen: glibc otherwise hands each back to the system and
# asks for it again, a tenth of the time that a scene takes. The process holds 0.7 GB after a
# million moves instead; other systems ignore these.
_KEEP_MEMORY: Final = {
    "MALLOC_MMAP_THRESHOLD_": "4000000000",
    "MALLOC_TRIM_THRESHOLD_": "4000000000",
}


class SceneMaker:
    """Makes scenes, one at a time, without the event loop waiting for any of it.

    While a print goes on they are made behind it; else somebody waits for them. The process begins
    with `start`, best when the server does (importing and loading the kernels takes seconds), or
    with the first job; it begins again when it died.

    Parameters
    ----------
    printing : callable
        Tells whether a print goes on.
    longest_s : float, s
        That a scene may take.
    """

    def __init__(
        self, printing: Callable[[], bool] = lambda: False, longest_s: float = _LONGEST_S
    ) -> None:
        self._printing = printing
        self._longest_s = longest_s
        self._process: asyncio.subprocess.Process | None = None
        self._one = asyncio.Lock()

    async def start(self) -> None:
        """Begin the process unless it runs."""
        if self._process is not None and self._process.returncode is None:
            return
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "printctl.web.live",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=os.environ | _KEEP_MEMORY,
        )

    async def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            process.kill()
            await process.wait()

    async def scene_file(self, source: JobSource) -> Path:
        """The file of a job's scene, made now unless it is there.

        Raises
        ------
        SceneError
            When the job can't be shown; the message is for the user.
        """
        path = await asyncio.to_thread(cached_scene, source)
        if path.is_file():
            return path
        async with self._one:
            return Path(await self._made(source))

    async def _made(self, source: JobSource) -> str:
        await self.start()
        try:
            async with asyncio.timeout(self._longest_s):
                when = BEHIND if await asyncio.to_thread(self._printing) else NOW
                answer = await self._ask(f"{when} {source.to_json()}")
        except TimeoutError as exc:
            await self.close()
            raise SceneError(
                f"the view of {source.gcode.name} wasn't made in {self._longest_s:g} s; "
                "the print isn't touched by it"
            ) from exc
        except BaseException:
            # Whoever asked is gone: the answer still to come mustn't meet the next question.
            await self.close()
            raise
        if "error" in answer:
            raise SceneError(answer["error"])
        return answer["scene"]

    async def _ask(self, line: str) -> dict[str, str]:
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise SceneError("the process that makes views was closed")
        try:
            process.stdin.write(line.encode() + b"\n")
            await process.stdin.drain()
            said = await process.stdout.readline()
        except OSError as exc:
            raise SceneError(f"the process that makes views: {exc.strerror}") from exc
        if not said:
            raise SceneError("the process that makes views ended; look into the server's messages")
        reply: dict[str, str] = json.loads(said)
        return reply
