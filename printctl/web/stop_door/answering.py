"""The door's few requests: ``POST /stop``, ``GET /alive``, and what a browser asks before them.

A page of the server's is of another port, so another origin: it gets CORS headers, nobody else.
A stop is answered by two lines of JSON: at once what went out, then what the printers said.
"""

from __future__ import annotations

import hmac
import json
import time
from dataclasses import asdict
from http.server import BaseHTTPRequestHandler
from typing import Any, Final

from printctl.web.security.cookies import cookie_of
from printctl.web.security.sessions import GRACE_S
from printctl.web.stop_door.order import DoorOrder
from printctl.web.stop_door.wires import Wires

_PATIENCE_S: Final = 2.5
_LONGEST_BODY: Final = 4096


class Answering(BaseHTTPRequestHandler):
    """One connection of a browser or script; `order` and `wires` are the class's."""

    order: DoorOrder
    wires: Wires
    protocol_version = "HTTP/1.1"
    server_version = "printctl"
    sys_version = ""
    timeout = 60.0
    disable_nagle_algorithm = True

    def do_POST(self) -> None:
        """Stop."""
        began = self.wires.clock()
        self.rfile.read(min(int(self.headers.get("Content-Length") or 0), _LONGEST_BODY))
        if self.path != "/stop":
            self._answer(404, {"error": "NotFoundError", "message": "there is only POST /stop"})
        elif self._allowed():
            self._stop(began)

    def do_GET(self) -> None:
        """Say that the door is there."""
        if self.path != "/alive":
            self._answer(404, {"error": "NotFoundError", "message": "there is only GET /alive"})
        elif self._allowed():
            self._answer(200, {"ready": True, "connected": self.wires.live})

    def do_OPTIONS(self) -> None:
        """Tell a browser that a script's header may be sent."""
        self.send_response(204)
        self._say_who_may_read()
        self.send_header("Access-Control-Allow-Headers", "authorization")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *args: Any) -> None:
        """Keep quiet: nothing here is worth the time, and a line could hold a secret."""

    # --- within --------------------------------------------------------------------------

    def _stop(self, began: float) -> None:
        sent = list(self.wires.kill(began))
        self.send_response(200)
        self._say_who_may_read()
        self.send_header("Content-Type", "application/x-ndjson")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()
        self._chunk({"sent": [asdict(one) for one in sent]})
        limit = self.wires.clock() + _PATIENCE_S
        said = []
        for one in sent:
            left = max(limit - self.wires.clock(), 0.1)
            said.append({"folder": one.folder, **self.wires.outcome(one.folder, left)})
        self._chunk({"outcome": said})
        self.wfile.write(b"0\r\n\r\n")

    def _chunk(self, message: dict[str, Any]) -> None:
        data = json.dumps(message).encode() + b"\n"
        self.wfile.write(b"%x\r\n%s\r\n" % (len(data), data))
        self.wfile.flush()

    def _allowed(self) -> bool:
        host = self._host()
        if host is None:
            return self._refuse(421, "this host isn't a name of this server")
        origin = self.headers.get("Origin")
        if origin is not None and not self._ours(origin, host):
            return self._refuse(403, "asked for by a page of another origin")
        kind, _, shown = (self.headers.get("Authorization") or "").partition(" ")
        if kind.lower() == "bearer":
            if hmac.compare_digest(shown.strip().encode(), self.order.token.encode()):
                return True
            time.sleep(0.2)  # this thread alone
            return self._refuse(401, "wrong token; it stands in .printctl/serve.json")
        cookie = cookie_of(self.headers.get("Cookie") or "", self.order.cookie)
        if origin is not None and self.order.sessions.read(cookie, GRACE_S):
            return True
        return self._refuse(401, "no session: open the page first, or send a token")

    def _host(self) -> str | None:
        return self.order.ours.host(self.headers.get("Host") or "")

    def _ours(self, origin: str, host: str) -> bool:
        return self.order.ours.is_origin_at(origin, host, self.order.page_port)

    def _refuse(self, status: int, message: str) -> bool:
        self._answer(status, {"error": "NotAllowedError", "message": message})
        return False

    def _answer(self, status: int, message: dict[str, Any]) -> None:
        data = json.dumps(message).encode()
        self.send_response(status)
        self._say_who_may_read()
        self.send_header("Content-Type", "application/json")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _say_who_may_read(self) -> None:
        self.send_header("Vary", "Origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        host, origin = self._host(), self.headers.get("Origin")
        if host is not None and origin is not None and self._ours(origin, host):
            self.send_header("Access-Control-Allow-Origin", origin)
            self.send_header("Access-Control-Allow-Credentials", "true")
