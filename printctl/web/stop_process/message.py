"""Parse HTTP/1.1 requests and write responses for the stop process. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

LONGEST_HEAD: Final = 16_384
LONGEST_BODY: Final = 4096
_REASONS: Final = {200: "OK", 204: "No Content", 400: "Bad Request", 413: "Content Too Large"}


class BadMessageError(Exception):
    """What was sent isn't a request that the stop process reads."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class Request:
    """One request.

    Attributes
    ----------
    method, path : str
    headers : dict
        Lower-case name to value; of one given twice the last.
    """

    method: str
    path: str
    headers: dict[str, str] = field(default_factory=dict)

    @property
    def closes(self) -> bool:
        """Whether the other side wants the connection closed after the answer."""
        return self.headers.get("connection", "").lower() == "close"


def read_request(data: bytes) -> tuple[Request | None, bytes]:
    """Return the first whole request in ``data`` and the rest; None while it isn't whole.

    Raises
    ------
    BadMessageError
    """
    head, whole, rest = data.partition(b"\r\n\r\n")
    if len(head) > LONGEST_HEAD:
        raise BadMessageError(413, f"a request's head has at most {LONGEST_HEAD} bytes here")
    if not whole:
        return None, data
    first, *lines = head.lstrip(b"\r\n").decode("latin-1").split("\r\n")
    words = first.split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        raise BadMessageError(400, "this isn't an HTTP/1.1 request")
    headers = dict(_header(line) for line in lines)
    length = _length(headers.get("content-length", "0"))
    if len(rest) < length:
        return None, data
    return Request(words[0], words[1], headers), rest[length:]


def answer_head(status: int, headers: dict[str, str]) -> bytes:
    """Return the head of an answer."""
    lines = [f"HTTP/1.1 {status} {_REASONS.get(status, 'Refused')}"]
    lines += [f"{name}: {value}" for name, value in headers.items()]
    return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1", "replace")


def chunk(data: bytes) -> bytes:
    """Return a piece of an answer of unknown length; an empty one ends it."""
    return b"%x\r\n%b\r\n" % (len(data), data)


def _header(line: str) -> tuple[str, str]:
    name, colon, value = line.partition(":")
    if not colon:
        raise BadMessageError(400, "a line of the request's head has no colon")
    return name.strip().lower(), value.strip()


def _length(said: str) -> int:
    if not said.isascii() or not said.isdigit():
        raise BadMessageError(400, "Content-Length isn't a number")
    if len(said) > 8 or int(said) > LONGEST_BODY:
        raise BadMessageError(413, f"a request's body has at most {LONGEST_BODY} bytes here")
    return int(said)
