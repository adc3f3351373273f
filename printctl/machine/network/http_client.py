"""HTTP to a network host: one connection per user, and one kept ready for the emergency stop."""

from __future__ import annotations

import functools
import http.client
import inspect
import json
import math
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Final, NamedTuple
from urllib.parse import quote, quote_plus

from printctl.machine.errors import HostRefused, HostSilent
from printctl.machine.network.host import KEY_VARIABLE, HostAddress, HostReport, HostRequest

CONNECT_S: Final = 3.0
ANSWER_S: Final = 4.0
CHECK_READY_S: Final = 1.0
"""Interval at which the ready connection is looked at, and opened anew where the host closed it."""
READY_ANSWER_S: Final = 0.5
"""Longest wait on the ready connection, which may be dead without a sign, before a new one."""
IDLE_S: Final = 1.0
"""A connection unused for longer isn't used again: something on the way may have forgotten it."""
_CHUNK_BYTES: Final = 16_384
_MAX_ANSWER_BYTES: Final = 8 * 2**20
_WORDS: Final = 500
_ODD: Final = (AttributeError, ArithmeticError, LookupError, RecursionError, TypeError, ValueError)
"""What reading JSON of another shape raises."""


class HttpReply(NamedTuple):
    """Status and body of an answer."""

    status: int
    body: bytes

    def json(self) -> Any:
        """Return the body's JSON value; ValueError where it is none."""
        return json.loads(self.body)


class HttpClient:
    """One kept-open connection to a host; for one thread.

    A request is never sent twice: the caller knows whether that would do harm.
    """

    def __init__(self, address: HostAddress, headers: dict[str, str] | None = None) -> None:
        self.address, self.headers = address, dict(headers or {})
        self._connection: http.client.HTTPConnection | None = None
        self.answered_at = -math.inf
        """When an answer came last, s by `time.monotonic`."""

    def get(self, path: str) -> Any:
        """Return the JSON answer to a GET."""
        return self.send(HostRequest("GET", path)).json()

    def post(self, path: str, values: Any = None, limit_s: float = ANSWER_S) -> HttpReply:
        """Send a POST with a JSON body, or none."""
        body = b"" if values is None else json.dumps(values).encode()
        headers = {} if values is None else {"Content-Type": "application/json"}
        return self.send(HostRequest("POST", path, body, headers), limit_s)

    def send(
        self,
        request: HostRequest,
        limit_s: float = ANSWER_S,
        check: Callable[[float], None] | None = None,
        max_bytes: int = _MAX_ANSWER_BYTES,
    ) -> HttpReply:
        """Send a request and return its answer; ``check`` gets the share of the body sent.

        Of a longer answer than ``max_bytes`` the rest isn't read.

        Raises
        ------
        HostSilent
            Without an answer; ``sent`` is False where no byte can have reached the host.
        HostRefused
            For a status of 400 or above.
        """
        where = f"{self.address}: {request.method} {request.path.partition('?')[0]}"
        connection = self._open(where)
        body = request.body if check is None else _checked(request.body, check)
        headers = {**self.headers, **request.headers, "Content-Length": str(len(request.body))}
        begun_s = time.monotonic()
        try:
            if connection.sock is not None:
                connection.sock.settimeout(limit_s)
            connection.request(request.method, request.path, body, headers)
            with _ended_after(connection.sock, limit_s):
                answer = connection.getresponse()
                reply = HttpReply(answer.status, answer.read(max_bytes))
            self.answered_at = time.monotonic()
        except (OSError, http.client.HTTPException) as exc:
            self.close()
            late = time.monotonic() - begun_s >= limit_s
            why = f"nothing whole within {limit_s:g} s" if late else _reason(exc)
            raise HostSilent(f"{where}: no answer ({why})") from None
        except BaseException:
            self.close()
            raise
        if answer.will_close or len(reply.body) == max_bytes:
            self.close()
        if reply.status >= 400:
            raise HostRefused(f"{where}: {_refusal(reply)}", reply.status)
        return reply

    def close(self) -> None:
        """Let go of the connection; the next request opens another."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _open(self, where: str) -> http.client.HTTPConnection:
        idle = time.monotonic() - self.answered_at > IDLE_S
        if self._connection is not None and (idle or was_closed(self._connection.sock)):
            self.close()
        if self._connection is None:
            try:
                self._connection = _connect(self.address)
            except ssl.SSLCertVerificationError as exc:
                raise HostRefused(
                    f"{where}: the host's certificate isn't trusted ({exc.verify_message}); name "
                    "the file of a lab's own CA by the environment (SSL_CERT_FILE)"
                ) from None
            except OSError as exc:
                why = f"{where}: no connection ({_reason(exc)})"
                if isinstance(exc, ssl.SSLError):
                    kind = self.address.kind
                    why += f"; if this port isn't one of HTTPS, name it {kind}://, without +https"
                raise HostSilent(why, sent=False) from None
        return self._connection


class HttpHost:
    """Part of every host: its connection, with the key as a header where one is given.

    Each public method of a host raises HostRefused for an answer that it can't read, and repeats
    the key in no message, whatever the answer has of it.
    """

    begun = False

    def __init_subclass__(cls) -> None:
        for name, method in vars(cls).items():
            if inspect.isfunction(method) and not name.startswith("_"):
                setattr(cls, name, _checked_answer(method))

    def __init__(self, address: HostAddress, key: str = "") -> None:
        self.http, self.secret = HttpClient(address, {"X-Api-Key": key} if key else {}), key

    def without_key(self, words: str) -> str:
        """Return a message without the host's key."""
        for secret in filter(None, {self.secret, quote(self.secret), quote_plus(self.secret)}):
            words = words.replace(secret, "***")
        return words

    @property
    def answered_at(self) -> float:
        """When the host answered last, s by `time.monotonic`."""
        return self.http.answered_at

    def active_file(self, name: str) -> str:
        """Return the name of the file whose lines are run; see `PrintHost`."""
        return self.state(name).active_file  # type: ignore[attr-defined]

    def close(self) -> None:
        """Let go of the connection."""
        self.http.close()


def _checked_answer(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a host's method with the two promises of `HttpHost`."""

    @functools.wraps(method)
    def checked(host: HttpHost, *given: Any) -> Any:
        def masked(words: str) -> str:  # the name that was asked for stays, whatever the key is
            return words if words.startswith(given) else host.without_key(words)

        try:
            answer = method(host, *given)
        except (HostRefused, HostSilent) as exc:
            exc.args = (host.without_key(str(exc))[:_WORDS],)  # cut before, a part would stay
            raise
        except _ODD as exc:
            json_there = not isinstance(exc, json.JSONDecodeError)
            why = "its JSON isn't what this kind of host sends" if json_there else "it isn't JSON"
            words = f"{host.http.address}: the answer can't be read: {why}; does a proxy, a login "
            words += "page or another program listen at this port?"
            raise HostRefused(host.without_key(words)) from None
        if isinstance(answer, str):
            return masked(answer)
        if isinstance(answer, HostReport):
            words = host.without_key(answer.message)
            return replace(answer, message=words, file=masked(answer.file))
        return answer

    return checked


class ReadyConnection:
    """Connection opened beforehand and used for one urgent request.

    A thread of its own looks after it, while `hold` says so. `send` waits neither for that thread
    nor for any other request; any thread may call it.
    """

    def __init__(self, address: HostAddress) -> None:
        self._address = address
        self._lock, self._over, self._wake = threading.Lock(), threading.Event(), threading.Event()
        self._held = False
        self._socket: socket.socket | None = None
        self._keeper = threading.Thread(target=self._keep, name="ready", daemon=True)
        self._keeper.start()

    def hold(self, held: bool) -> None:
        """Keep a connection open, or none.

        None to a host that doesn't answer: an idle connection keeps OctoPrint from starting, whose
        first server takes one at a time and is waited for.
        """
        if held != self._held:
            self._held = held
            self._wake.set()

    def send(self, request: HostRequest, limit_s: float = ANSWER_S) -> int:
        """Send a request at once; return the status of the answer.

        Where the ready connection is broken a new one is opened. HostSilent without an answer.
        """
        head = {"Host": self._address.authority, **request.headers}
        head |= {"Content-Length": str(len(request.body)), "Connection": "close"}
        lines = [
            f"{request.method} {request.path} HTTP/1.1",
            *(f"{k}: {v}" for k, v in head.items()),
        ]
        data = "\r\n".join([*lines, "", ""]).encode("latin-1") + request.body
        with self._lock:
            ready, self._socket = self._socket, None
        reason = "no connection"
        ends = (None,) if ready is None else (ready, None)
        for end in ends:
            try:
                return self._exchange(
                    end, data, request.method, limit_s if end is None else READY_ANSWER_S
                )
            except (OSError, http.client.HTTPException) as exc:
                reason = _reason(exc)
        raise HostSilent(f"{self._address}: the emergency stop has no answer ({reason})")

    def close(self) -> None:
        """End the thread and let go of the connection."""
        self._over.set()
        self._wake.set()
        self._keeper.join(CONNECT_S)
        self._swap(None)

    def _exchange(self, end: socket.socket | None, data: bytes, method: str, limit_s: float) -> int:
        with end or _connect(self._address).sock as used, _ended_after(used, limit_s):
            used.settimeout(limit_s)
            used.sendall(data)
            answer = http.client.HTTPResponse(used, method=method)
            answer.begin()
            return answer.status

    def _keep(self) -> None:
        while not self._over.is_set():
            with self._lock:  # `send` must not lose an answer to this look
                closed = was_closed(self._socket)
            if not self._held:
                self._swap(None)
            elif closed:
                with suppress(OSError):
                    self._swap(_connect(self._address).sock)
            self._wake.wait(CHECK_READY_S)
            self._wake.clear()

    def _swap(self, fresh: socket.socket | None) -> None:
        with self._lock:
            old, self._socket = self._socket, fresh
        if old is not None:
            old.close()


def _connect(address: HostAddress) -> http.client.HTTPConnection:
    """Open a connection; where it is encrypted, to a host whose certificate is trusted alone."""
    if address.encrypted:
        trusted = ssl.create_default_context()
        fresh: http.client.HTTPConnection = http.client.HTTPSConnection(
            address.host, address.port, timeout=CONNECT_S, context=trusted
        )
    else:
        fresh = http.client.HTTPConnection(address.host, address.port, CONNECT_S)
    fresh.connect()
    fresh.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return fresh


@contextmanager
def _ended_after(end: socket.socket | None, limit_s: float) -> Iterator[None]:
    """Break a connection off after a time, however slowly its answer drips."""

    def shut() -> None:
        with suppress(OSError):
            if end is not None:
                end.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(limit_s, shut)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def was_closed(end: socket.socket | None) -> bool:
    """Whether an unused connection was closed by its far side, or had something unread."""
    try:
        if end is not None:
            end.settimeout(0.0)
            end.recv(1)  # TLS has news of its own to read, which are no answer
    except (BlockingIOError, ssl.SSLWantReadError):
        return False
    except OSError:
        pass
    return True


def multipart(fields: dict[str, str], name: str, data: bytes) -> HostRequest:
    """Return the body and headers of a form with one file; method and path are empty."""
    mark = "printctl-6d1f0c7b52a94e38"
    head = "".join(
        f'--{mark}\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n{value}\r\n'
        for key, value in fields.items()
    )
    head += f'--{mark}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
    head += "Content-Type: application/octet-stream\r\n\r\n"
    body = head.encode() + data + f"\r\n--{mark}--\r\n".encode()
    return HostRequest("", "", body, {"Content-Type": f"multipart/form-data; boundary={mark}"})


def _checked(body: bytes, check: Callable[[float], None]) -> Iterator[bytes]:
    for begin in range(0, len(body), _CHUNK_BYTES):
        check(begin / len(body))
        yield body[begin : begin + _CHUNK_BYTES]


def _reason(exc: Exception) -> str:
    """Say what broke a connection, without words of the host: they may repeat a key."""
    words = str(exc) if isinstance(exc, OSError) else ""
    return getattr(exc, "strerror", None) or words or type(exc).__name__


def _refusal(reply: HttpReply) -> str:
    """Return a refusal in the host's own words."""
    words = reply.body.decode("utf-8", "replace").strip()
    try:
        value = json.loads(words)
        error = value.get("error", value) if isinstance(value, dict) else value
        words = str(error.get("message", error) if isinstance(error, dict) else error)
    except (ValueError, RecursionError):
        pass
    if reply.status in (401, 403):
        return (
            f"the host refuses the key (HTTP {reply.status}); give it by the environment "
            f"({KEY_VARIABLE}) or a file (--host-key)"
        )
    return f"HTTP {reply.status}: {' '.join(words.split())}"
