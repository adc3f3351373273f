"""Work in processes of low priority."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import Any, Final, TypeVar

from printctl.errors import PrintctlError
from printctl.sources import python_command
from printctl.web.errors import ConflictError

_LATER: Final = 10
T = TypeVar("T")
LONGEST_LINE: Final = 2**26
"""Of a process's answer, bytes."""


def lower_priority(niceness: int = _LATER) -> None:
    """Let what this thread does run behind a print; for good, since only root may step forward.

    Outside Linux it is the whole process; on Windows, which has no such thing, nothing happens.
    """
    with contextlib.suppress(AttributeError, OSError):  # no os.nice on Windows
        os.nice(max(niceness - os.nice(0), 0))


def run_at_low_priority(work: Callable[[], T]) -> T:
    """Do something in a thread of its own that has stepped back; what is done later hasn't."""
    with ThreadPoolExecutor(1, initializer=lower_priority) as behind:
        return behind.submit(work).result()


def run_worker(
    module: str, *words: str, said: str = "", longest_s: float, late: str, died: str
) -> str:
    """Run a module's ``main`` in a process, with arguments and ``said`` to read; return its output.

    Raises
    ------
    ConflictError
        With the message ``late`` when it takes longer than ``longest_s``, or ``died`` and the last
        line that it wrote to stderr when it ends in failure.
    """
    try:
        done = subprocess.run(
            [*python_command(__name__), module, *words],
            input=said,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=longest_s,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise ConflictError(late) from exc
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no word"]
        raise ConflictError(f"{died}: {last[0][:500]}")
    return done.stdout


class LineProcess:
    """A process of ours that answers each line by a line of JSON, one at a time.

    ``turn`` is to be held while it is asked; ``env`` is added to its environment.
    """

    def __init__(self, module: str, env: Mapping[str, str] | None = None) -> None:
        self._module, self._env = module, os.environ | dict(env or {})
        self.turn = asyncio.Lock()
        self.process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """Begin the process unless it runs."""
        if self.process is None or self.process.returncode is not None:
            self.process = await asyncio.create_subprocess_exec(
                *python_command(self._module),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env=self._env,
                limit=LONGEST_LINE,
            )

    async def close(self) -> None:
        """End the process."""
        process, self.process = self.process, None
        if process is not None and process.returncode is None:
            process.kill()
            await process.wait()

    async def ask(
        self, line: str, longest_s: float, refusal: type[PrintctlError], late: str, died: str
    ) -> dict[str, Any]:
        """Return what it answers to a line; without an answer it is ended, and begins anew.

        Raises
        ------
        PrintctlError
            A ``refusal`` with the error that it answers, the message ``late`` when it takes longer
            than ``longest_s``, or ``died`` and why when it ended in place of answering.
        """
        await self.start()
        try:
            async with asyncio.timeout(longest_s):
                answer = await self._answer(line)
        except BaseException as exc:
            # Too late, or who asked is gone: the answer to come mustn't meet the next question.
            await self.close()
            if isinstance(exc, TimeoutError):
                raise refusal(late) from exc
            if isinstance(exc, OSError):
                raise refusal(f"{died}: {exc.strerror or exc}") from exc
            raise
        if "error" in answer:
            raise refusal(answer["error"])
        return answer

    async def _answer(self, line: str) -> dict[str, Any]:
        process = self.process
        if process is None or process.stdin is None or process.stdout is None:
            raise ConnectionError("it was closed")
        process.stdin.write(line.encode() + b"\n")
        await process.stdin.drain()
        said = await process.stdout.readline()
        if not said:
            raise ConnectionError("look into the server's messages")
        answer: dict[str, Any] = json.loads(said)
        return answer


if __name__ == "__main__":
    sys.exit(import_module(sys.argv.pop(1)).main())
