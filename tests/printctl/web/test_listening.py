"""Limits of connections: who shows a session or token is kept, others go in time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from printctl.web.serving import listening
from printctl.web.serving.listening import Connections, bind

Connect = Callable[[bytes], Coroutine[Any, Any, asyncio.StreamReader]]


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    """Know who asks for /known; read the body of every other request."""
    if scope["path"] == "/known":
        scope["state"]["know"]()
    else:
        while (await receive()).get("more_body"):
            pass
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body"})


def serving(of: Callable[[Connect], Coroutine[Any, Any, None]]) -> None:
    """Run ``of`` with what connects, sends some bytes and gives what reads the answer."""

    async def run() -> None:
        config = uvicorn.Config(app, lifespan="off", ws="none", log_config=None)
        config.load()
        listener = bind("127.0.0.1", 0)
        accepting = asyncio.create_task(Connections(config, ServerState(), {}).accept(listener))
        kept = []

        async def connect(sent: bytes) -> asyncio.StreamReader:
            reader, writer = await asyncio.open_connection(*listener.getsockname())
            writer.write(sent)
            kept.append(writer)
            return reader

        await of(connect)
        for writer in kept:
            writer.close()
        for _ in range(20):  # until the other side has seen it
            await asyncio.sleep(0.01)
        accepting.cancel()
        listener.close()

    asyncio.run(run())


KNOWN = b"GET /known HTTP/1.1\r\nHost: a\r\n\r\n"
POST = b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\n"


def test_idle_and_half_sent_requests_are_closed_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "SHOW_S", 0.2)

    async def of(connect: Connect) -> None:
        known = await connect(KNOWN)
        for sent in (b"", b"GET / HTTP/1.1\r\nHo", POST + b"1"):
            assert await (await connect(sent)).read() == b""
        assert (await known.readline()).split()[1] == b"204"
        assert not known.at_eof()

    serving(of)


def test_of_too_many_strangers_the_oldest_go_and_a_new_one_is_answered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(listening, "STRANGERS", 8)

    async def of(connect: Connect) -> None:
        known = await connect(KNOWN)
        await known.readuntil(b"\r\n\r\n")
        crowd = [await connect(b"") for _ in range(20)]
        assert await crowd[0].read() == b""
        assert b"204" in await (await connect(POST + b"123456789")).readline()
        assert not known.at_eof()

    serving(of)


def test_of_too_many_known_ones_the_oldest_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "KNOWN", 2)

    async def of(connect: Connect) -> None:
        known = [await connect(KNOWN) for _ in range(3)]
        for one in known:
            await one.readuntil(b"\r\n\r\n")
        assert await known[0].read() == b""
        assert not known[2].at_eof()

    serving(of)
