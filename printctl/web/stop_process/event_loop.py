"""Event loop of the stop process: one thread serves all connections without blocking.

A stop is carried out by a thread of its own, which the loop hears of through a queue: at once what
went out, then what the printers said, two lines of JSON.
"""

from __future__ import annotations

import contextlib
import errno
import json
import selectors
import socket
import ssl
import threading
import time
from collections import deque
from dataclasses import asdict
from typing import Any, Final

from printctl.web.stop_process.connection_limit import UNKNOWN, Connection, Places
from printctl.web.stop_process.connections import Wires
from printctl.web.stop_process.message import (
    BadMessageError,
    Request,
    answer_head,
    chunk,
    read_request,
)
from printctl.web.stop_process.responses import Answering
from printctl.web.stop_process.start_message import StartMessage

_BACKLOG: Final = 1024
_ACCEPTED_AT_ONCE: Final = 64
_SWEEP_S: Final = 0.25
_PATIENCE_S: Final = 2.5
_PAUSE_S: Final = 0.02
_NO_HANDLE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_MOST_HEARD: Final = 65_536
_AGAIN: Final = (BlockingIOError, InterruptedError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


class StopServer:
    """Listens from the start; `serve` answers until the process ends.

    Parameters
    ----------
    order : StartMessage
    port : int
        0 for any.
    wires : Wires
    """

    def __init__(self, order: StartMessage, port: int, wires: Wires) -> None:
        family = socket.AF_INET6 if ":" in order.host else socket.AF_INET
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind((order.host, port))
        self._listener.listen(_BACKLOG)
        self._context: ssl.SSLContext | None = None
        if order.cert:
            self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            self._context.load_cert_chain(order.cert, order.key or None)
        self._wires, self._answering = wires, Answering(order)
        self._places = Places(min(UNKNOWN, _files() // 2))
        self._mail: deque[tuple[Connection, bytes, bool]] = deque()
        self._selector = selectors.DefaultSelector()
        self._waker, self._woken = socket.socketpair()
        for end in (self._listener, self._waker, self._woken):
            end.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._swept = 0.0

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._listener.getsockname()[1])

    def serve(self) -> None:
        """Answer for ever."""
        while True:
            for key, mask in self._selector.select(_SWEEP_S):
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is self._woken:
                    with contextlib.suppress(BlockingIOError):
                        self._woken.recv(4096)
                else:
                    self._attend(key.data, mask)
            self._deliver()
            self._sweep()

    # --- connections -------------------------------------------------------------------------

    def _accept(self) -> None:
        for _ in range(_ACCEPTED_AT_ONCE):
            try:
                accepted, address = self._listener.accept()
            except OSError as exc:  # nobody more; or no handle is left for one
                if exc.errno in _NO_HANDLE and not self._one_leaves():
                    time.sleep(_PAUSE_S)  # others have them all: wait, don't spin
                return
            try:
                accepted.setblocking(False)
                accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                new = Connection(accepted, str(address[0]), self._wires.clock())
                if self._context is not None:
                    new.socket = self._context.wrap_socket(
                        accepted, server_side=True, do_handshake_on_connect=False
                    )
                    new.shaking = True
            except (OSError, ValueError):  # gone already
                accepted.close()
                continue
            self._selector.register(new.socket, selectors.EVENT_READ, new)
            self._drop(self._places.take(new))
            self._attend(new, selectors.EVENT_READ)  # most have sent their request already

    def _one_leaves(self) -> bool:
        """Drop the oldest unknown connection; whether there was one."""
        leaver = self._places.oldest_unknown()
        self._drop(leaver)
        return leaver is not None

    def _drop(self, one: Connection | None) -> None:
        if one is not None and self._places.leave(one):
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(one.socket)
            with contextlib.suppress(OSError):
                one.socket.close()

    def _sweep(self) -> None:
        now = self._wires.clock()
        if now - self._swept > _SWEEP_S:
            self._swept = now
            for one in self._places.late(now):
                self._drop(one)

    def _attend(self, one: Connection, mask: int) -> None:
        try:
            if one.shaking:
                self._shake(one)
            if not one.shaking:
                self._flush(one)
                if mask & selectors.EVENT_READ:
                    self._read(one)
        except OSError:
            self._drop(one)

    def _shake(self, one: Connection) -> None:
        wants = selectors.EVENT_READ
        try:
            assert isinstance(one.socket, ssl.SSLSocket)
            one.socket.do_handshake()
            one.shaking = False
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLWantWriteError:
            wants |= selectors.EVENT_WRITE
        self._selector.modify(one.socket, wants, one)

    def _read(self, one: Connection) -> None:
        while len(one.heard) < _MOST_HEARD:
            try:
                data = one.socket.recv(16_384)
            except _AGAIN:
                break
            if not data:
                self._drop(one)
                return
            one.heard += data
        if len(one.heard) >= _MOST_HEARD:
            self._drop(one)
        elif one.heard:
            self._answer(one)

    # --- requests ----------------------------------------------------------------------------

    def _answer(self, one: Connection) -> None:
        """Answer what was heard; while a stop goes on, what comes after it waits."""
        try:
            while not (one.stopping or one.closing):
                request, one.heard = read_request(one.heard)
                if request is None:
                    break
                self._answer_one(one, request)
        except BadMessageError as exc:
            text = str(exc).encode()
            head = {"Content-Length": str(len(text)), "Content-Type": "text/plain"}
            one.unsent += answer_head(exc.status, head) + text
            one.closing = True
        self._flush(one)

    def _answer_one(self, one: Connection, request: Request) -> None:
        began = self._wires.clock()
        answer = self._answering.answer(request, self._wires.live)
        if answer.known:
            one.since = began
            self._drop(self._places.know(one))
        one.unsent += answer.data
        refused = not answer.known and request.method != "OPTIONS"
        one.closing = request.closes or refused
        if answer.stops:
            one.stopping = True
            threading.Thread(target=self._stop, args=(one, began), name="stop", daemon=True).start()

    def _flush(self, one: Connection) -> None:
        while one.unsent:
            try:
                one.unsent = one.unsent[one.socket.send(one.unsent) :]
            except _AGAIN:
                break
        if not one.unsent and one.closing and not one.stopping:
            self._drop(one)
        elif one in self._places:
            wants = selectors.EVENT_READ | (selectors.EVENT_WRITE if one.unsent else 0)
            self._selector.modify(one.socket, wants, one)

    # --- a stop ------------------------------------------------------------------------------

    def _stop(self, one: Connection, began: float) -> None:
        sent, said = [], []
        try:
            sent = list(self._wires.kill(began))
            self._post(one, {"sent": [asdict(each) for each in sent]})
            limit = self._wires.clock() + _PATIENCE_S
            for each in sent:
                left = max(limit - self._wires.clock(), 0.1)
                said.append({"folder": each.folder, **self._wires.outcome(each.folder, left)})
        finally:
            self._post(one, {"outcome": said}, over=True)

    def _post(self, one: Connection, message: dict[str, Any], over: bool = False) -> None:
        data = chunk(json.dumps(message).encode() + b"\n") + (chunk(b"") if over else b"")
        self._mail.append((one, data, over))
        with contextlib.suppress(OSError):  # full: the loop is awake anyway
            self._waker.send(b"!")

    def _deliver(self) -> None:
        while self._mail:
            one, data, over = self._mail.popleft()
            if one not in self._places:
                continue
            one.unsent += data
            one.stopping = one.stopping and not over
            try:
                self._flush(one)
                if over:
                    one.since = self._wires.clock()
                    self._answer(one)
            except OSError:
                self._drop(one)


def _files() -> int:
    """Ask for as many files as the system gives; return how many."""
    try:
        import resource  # Windows has none: its sockets aren't counted as files.
    except ImportError:
        return 2 * UNKNOWN
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 2 * UNKNOWN if most == resource.RLIM_INFINITY else min(2 * UNKNOWN, most)
    if soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))
    return max(soft, wanted)
