"""Simulated remote browsers: WebSocket clients that receive all events and draw nothing.

``python -m benchmarks.operator.watch RECORD COUNT`` listens until it is ended; RECORD is the
server's ``serve.json``.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aiohttp


async def _listen(url: str, token: str, count: int) -> None:
    headers = {"Authorization": f"Bearer {token}"}
    async with aiohttp.ClientSession(headers=headers) as session:

        async def one() -> None:
            async with session.ws_connect(f"{url}/api/v1/events") as socket:
                async for _ in socket:
                    pass

        await asyncio.gather(*(one() for _ in range(count)))


@contextmanager
def listeners(record: Path, count: int) -> Iterator[None]:
    """So many listeners in a process of their own."""
    command = [sys.executable, "-m", "benchmarks.operator.watch", str(record), str(count)]
    with subprocess.Popen(command) as process:
        try:
            yield
        finally:
            process.terminate()


if __name__ == "__main__":
    said = json.loads(Path(sys.argv[1]).read_text())
    asyncio.run(_listen(said["url"].rstrip("/"), said["token"], int(sys.argv[2])))
