"""Answer the stop process's requests: ``POST /stop``, ``GET /alive`` and CORS preflights.

A page of the server's is of another port, so another origin: it gets CORS headers, nobody else.
A right token or session is never made to wait for anybody's wrong ones: tokens are too long to be
guessed, so wrong ones are refused and not counted.
"""

from __future__ import annotations

import hmac
import json
from dataclasses import dataclass
from typing import Any

from printctl.web.security.cookies import cookie_of
from printctl.web.security.sessions import GRACE_S
from printctl.web.stop_process.message import Request, answer_head
from printctl.web.stop_process.start_message import StartMessage


@dataclass(frozen=True)
class Answer:
    """What a request is answered with.

    Attributes
    ----------
    data : bytes
        The answer; of a stop its head alone.
    known : bool
        Whether a valid session or token was shown.
    stops : bool
        Whether to stop everything now.
    """

    data: bytes
    known: bool = False
    stops: bool = False


class Answering:
    """Answers requests; computes alone, and keeps nothing.

    Parameters
    ----------
    order : StartMessage
        Who may come.
    """

    def __init__(self, order: StartMessage) -> None:
        self._order, self._sessions, self._ours = order, order.sessions, order.ours

    def answer(self, request: Request, connected: int) -> Answer:
        """Answer a request; ``connected`` is told to who asks whether the stop process is there."""
        if request.method == "OPTIONS":
            more = {"Access-Control-Allow-Headers": "authorization", "Content-Length": "0"}
            return Answer(answer_head(204, {**self._who_may_read(request), **more}))
        wanted = {"POST": "/stop", "GET": "/alive"}.get(request.method)
        if wanted is None or request.path != wanted:
            said = (
                f"there is only {request.method} {wanted}" if wanted else "POST /stop, GET /alive"
            )
            return Answer(self.told(request, 404, {"error": "NotFoundError", "message": said}))
        refusal = self._refusal(request)
        if refusal is not None:
            status, text = refusal
            problem = {"error": "NotAllowedError", "message": text}
            return Answer(self.told(request, status, problem))
        if request.method == "POST":
            return Answer(self._stop_head(request), known=True, stops=True)
        alive = {"ready": True, "connected": connected}
        return Answer(self.told(request, 200, alive), known=True)

    def told(self, request: Request, status: int, message: dict[str, Any]) -> bytes:
        """Return a whole answer of JSON."""
        data = json.dumps(message).encode()
        headers = {"Content-Type": "application/json", "Content-Length": str(len(data))}
        return answer_head(status, {**self._who_may_read(request), **headers}) + data

    def _stop_head(self, request: Request) -> bytes:
        headers = {"Content-Type": "application/x-ndjson", "Transfer-Encoding": "chunked"}
        return answer_head(200, {**self._who_may_read(request), **headers})

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        """Return status and reason for who may not; None for who may."""
        host = self._host(request)
        if host is None:
            return 421, "this host isn't a name of this server"
        origin = request.headers.get("origin")
        if origin is not None and not self._is_ours(origin, host):
            return 403, "asked for by a page of another origin"
        kind, _, shown = request.headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            right = hmac.compare_digest(shown.strip().encode(), self._order.token.encode())
            return None if right else (401, "wrong token; it stands in .printctl/serve.json")
        cookie = cookie_of(request.headers.get("cookie", ""), self._order.cookie)
        if origin is not None and self._sessions.read(cookie, GRACE_S):
            return None
        return 401, "no session: open the page first, or send a token"

    def _host(self, request: Request) -> str | None:
        return self._ours.host(request.headers.get("host", ""))

    def _is_ours(self, origin: str, host: str) -> bool:
        return self._ours.is_origin_at(origin, host, self._order.page_port)

    def _who_may_read(self, request: Request) -> dict[str, str]:
        always = {
            "Vary": "Origin",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }
        host, origin = self._host(request), request.headers.get("origin")
        if host is None or origin is None or not self._is_ours(origin, host):
            return always
        return {
            **always,
            "Access-Control-Allow-Origin": origin,
            "Access-Control-Allow-Credentials": "true",
        }
