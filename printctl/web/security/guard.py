"""Access guard: middleware that authorises every HTTP and WebSocket request.

In this order: the ``Host`` must be ours; what changes something must come from our own page, or
from what isn't a page of another; there must be a session or a token. On the loopback a visit of
a page gets a session without log-in, unless a password is set.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from dataclasses import dataclass, field
from html import escape
from typing import Final
from urllib.parse import quote, urlencode

from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from printctl.web.controls import Principal
from printctl.web.security.bodies import BodyLimits
from printctl.web.security.gate import Gate
from printctl.web.security.headers import security_headers
from printctl.web.security.request_facts import RequestFacts
from printctl.web.security.sessions import LIFETIME_S, RENEW_S, Session

log = logging.getLogger("printctl.web")

PUBLIC: Final = ("/login", "/static/shell/", "/favicon.ico", "/api/v1/health")
"""What anybody may ask for who reaches the server; nothing in it is the user's."""
_FORBIDDEN: Final = 4403
"""Close code of a WebSocket that is refused."""


class RefusedError(Exception):
    """The guard's answer in place of the app's."""

    def __init__(self, answer: Response) -> None:
        super().__init__(answer.status_code)
        self.answer = answer


@dataclass
class Admission:
    """Who was let in, and the cookie to give them."""

    who: Principal | None
    session: Session | None = None
    cookie: str = ""


@dataclass
class Guard:
    """Access guard middleware.

    Attributes
    ----------
    app : ASGI app
    gate : Gate
    limits : BodyLimits
    """

    app: ASGIApp
    gate: Gate
    limits: BodyLimits
    _open: dict[str, set[asyncio.Event]] = field(default_factory=dict)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, as ASGI has it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        asking = RequestFacts.of(scope)
        nonce = secrets.token_urlsafe(16)
        dressed = self._dressed(asking, nonce, send)
        try:
            let = self._admit(asking)
            if let.cookie:
                dressed = self._with_cookie(let.cookie, dressed)
            if scope["type"] == "http":
                receive = self.limits.limited(scope, receive)
        except RefusedError as exc:
            await self._refuse(exc.answer, scope, receive, dressed)
            return
        except HTTPException as exc:
            answer = refusal(exc.status_code, str(exc.detail), "TooLargeError")
            await self._refuse(answer, scope, receive, dressed)
            return
        # NiceGUI writes this header into its page.
        headers = [one for one in scope["headers"] if one[0].lower() != b"x-forwarded-prefix"]
        state = {**scope.get("state", {}), "nonce": nonce, "guard": self}
        state |= {"principal": let.who, "session": let.session}
        inner = {**scope, "headers": headers, "state": state}
        if asking.websocket and let.session:
            await self._until_logged_out(let.session.id, inner, receive, dressed)
        else:
            await self.app(inner, receive, dressed)

    def logged_out(self, session: Session) -> None:
        """End a session: its cookie is void, its WebSockets are closed."""
        self.gate.sessions.revoke(session)
        for event in self._open.pop(session.id, set()):
            event.set()

    # --- who may ---------------------------------------------------------------------------

    def _admit(self, asking: RequestFacts) -> Admission:
        if self.gate.ours.host(asking.host) is None:
            raise RefusedError(
                refusal(
                    421,
                    f"host {asking.host[:80]!r} isn't a name of this server; use its address, or "
                    "name it by `printctl serve --name`",
                )
            )
        bearer = asking.bearer
        self._check_origin(asking, bearer)
        if bearer is not None:
            return self._by_token(asking, bearer)
        session = self.gate.sessions.read(asking.cookie(self.gate.cookie))
        if session:
            return self._by_session(asking, session)
        if "token" in asking.query and asking.for_page:
            self._by_link(asking)
        if asking.path.startswith(PUBLIC):
            return Admission(None)
        if asking.for_page:
            return self._by_visit(asking)
        raise RefusedError(
            refusal(401, "no session: open the page first, or send `Authorization: Bearer TOKEN`")
        )

    def _check_origin(self, asking: RequestFacts, bearer: str | None) -> None:
        origin = asking.headers.get("origin")
        if not asking.changes:
            if asking.site in ("cross-site", "same-site") and not asking.for_page:
                raise RefusedError(refusal(403, "asked for by a page of another origin"))
            return
        if origin is not None:
            ours = self.gate.ours.is_origin(origin, asking.host)
        else:  # a browser tells one or the other; what isn't one shows a token
            ours = asking.site == "same-origin" or (not asking.site and bearer is not None)
        if not ours:
            who = f"origin {origin[:80]!r} isn't" if origin is not None else "no origin that is"
            raise RefusedError(refusal(403, f"{who} this server's own page; scripts send a token"))

    def _by_token(self, asking: RequestFacts, shown: str) -> Admission:
        if not self.gate.is_token(shown):
            log.warning("wrong token from %s", asking.address)
            raise self._wrong_token(asking, "wrong token; it stands in .printctl/serve.json")
        return Admission(Principal("script", f"a script at {asking.address or 'this machine'}"))

    def _by_session(self, asking: RequestFacts, session: Session) -> Admission:
        old = self.gate.sessions.clock() - session.issued > RENEW_S
        renewed = self.gate.sessions.issue(session.id) if old else ""
        return Admission(_browser(asking, session), session, renewed)

    def _by_link(self, asking: RequestFacts) -> None:
        """Exchange the token in a link for a session, and the address for one without it."""
        if not self.gate.is_token(asking.query["token"][0]):
            raise self._wrong_token(asking, "the link's token is wrong: it is of another start")
        rest = {name: values for name, values in asking.query.items() if name != "token"}
        query = f"?{urlencode(rest, doseq=True)}" if rest else ""
        answer = RedirectResponse(quote(asking.path) + query, 303)
        self.set_cookie(answer, self.gate.sessions.issue())
        raise RefusedError(answer)

    def _by_visit(self, asking: RequestFacts) -> Admission:
        """A page asked for without a session."""
        if asking.site in ("cross-site", "same-site"):
            # A strict cookie isn't sent along a link of another site: ask once more, from here.
            query = urlencode(asking.query, doseq=True)
            again = escape(quote(asking.path) + (f"?{query}" if query else ""))
            raise RefusedError(
                HTMLResponse(
                    f'<!doctype html><html lang="en"><title>printctl</title>'
                    f'<meta http-equiv="refresh" content="0;url={again}">'
                    f'<a href="{again}">printctl</a>'
                )
            )
        if self.gate.open:
            cookie = self.gate.sessions.issue()
            session = self.gate.sessions.read(cookie)
            return Admission(_browser(asking, session) if session else None, session, cookie)
        raise RefusedError(RedirectResponse(f"/login?{urlencode({'next': asking.path})}", 303))

    def _wrong_token(self, asking: RequestFacts, message: str) -> RefusedError:
        """Refuse a wrong token, and tell who tries many to wait; the right one never waits."""
        wait = self.gate.token_throttle.wait_s(asking.address)
        if wait:
            return RefusedError(too_often(wait))
        self.gate.token_throttle.failed(asking.address)
        return RefusedError(refusal(401, message))

    # --- what goes out ---------------------------------------------------------------------

    def set_cookie(self, answer: Response, value: str) -> None:
        """Give a browser its session; an empty one takes it away."""
        answer.headers.append("set-cookie", self._cookie(value))

    def _cookie(self, value: str) -> str:
        secure = "; Secure" if self.gate.ours.scheme == "https" else ""
        age = int(LIFETIME_S) if value else 0
        return (
            f"{self.gate.cookie}={value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={age}{secure}"
        )

    def _with_cookie(self, value: str, send: Send) -> Send:
        async def given(message: Message) -> None:
            if message["type"] == "http.response.start":
                cookie = (b"set-cookie", self._cookie(value).encode("latin-1"))
                message = {**message, "headers": [*message["headers"], cookie]}
            await send(message)

        return given

    def _dressed(self, asking: RequestFacts, nonce: str, send: Send) -> Send:
        host = self.gate.ours.host(asking.host)
        web = "wss" if self.gate.ours.scheme == "https" else "ws"
        sources = f"{web}://{asking.host}" if host else ""
        if host and self.gate.stop_port:
            sources += f" {self.gate.ours.scheme}://{host}:{self.gate.stop_port}"
        headers = security_headers(nonce, sources)

        async def dressed(message: Message) -> None:
            if message["type"] == "http.response.start":
                had = {name.lower() for name, _ in message["headers"]}
                more = [one for one in headers if one[0] not in had]
                message = {**message, "headers": [*message["headers"], *more]}
            await send(message)

        return dressed

    async def _refuse(self, answer: Response, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            await answer(scope, receive, send)
        else:
            await receive()
            await send({"type": "websocket.close", "code": _FORBIDDEN, "reason": "not allowed"})

    async def _until_logged_out(
        self, session: str, scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Run a WebSocket; log-out ends it as if the browser had gone."""
        over = asyncio.Event()
        self._open.setdefault(session, set()).add(over)
        gone = asyncio.ensure_future(over.wait())

        async def watched() -> Message:
            if over.is_set():
                return {"type": "websocket.disconnect", "code": _FORBIDDEN}
            heard = asyncio.ensure_future(receive())
            try:
                await asyncio.wait({heard, gone}, return_when=asyncio.FIRST_COMPLETED)
                if heard.done():
                    return heard.result()
            finally:
                heard.cancel()
            return {"type": "websocket.disconnect", "code": _FORBIDDEN}

        try:
            await self.app(scope, watched, send)
            if over.is_set():
                with contextlib.suppress(RuntimeError):  # closed by the app, or gone by itself
                    await send({"type": "websocket.close", "code": _FORBIDDEN})
        finally:
            gone.cancel()
            self._open.get(session, set()).discard(over)


def refusal(status: int, message: str, error: str = "NotAllowedError") -> JSONResponse:
    """An answer that refuses."""
    return JSONResponse({"error": error, "message": message}, status)


def too_often(wait_s: int) -> JSONResponse:
    """The answer to too many attempts."""
    text = f"too many attempts; try again in {wait_s} s"
    return JSONResponse(
        {"error": "TooOftenError", "message": text}, 429, {"Retry-After": str(wait_s)}
    )


def _browser(asking: RequestFacts, session: Session) -> Principal:
    return Principal(session.id, f"{asking.browser} ({session.id[:3]})")
