"""Add a content-security-policy nonce to the scripts of a page (see `headers`)."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Nonces:
    """Middleware: gives each ``<script`` of an HTML answer the nonce in ``state["nonce"]``.

    It works on the page as NiceGUI writes it, before anything else is in it: what pages are given
    to show travels as JSON in which ``<`` is escaped.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, as ASGI has it."""
        nonce = scope.get("state", {}).get("nonce")
        if scope["type"] != "http" or nonce is None:
            await self.app(scope, receive, send)
            return
        start: Message = {}
        parts: list[bytes] = []

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start" and _is_html(message):
                start.update(message)
                return
            if not start or message["type"] != "http.response.body":
                await send(message)
                return
            parts.append(message.get("body", b""))
            if message.get("more_body"):
                return
            page = b"".join(parts).replace(b"<script", f'<script nonce="{nonce}"'.encode())
            start["headers"] = [
                (name, str(len(page)).encode() if name == b"content-length" else value)
                for name, value in start["headers"]
            ]
            await send(dict(start))
            await send({"type": "http.response.body", "body": page})

        await self.app(scope, receive, marked)


def _is_html(message: Message) -> bool:
    kinds = [v for name, v in message["headers"] if name.lower() == b"content-type"]
    return bool(kinds) and kinds[0].startswith(b"text/html")
