"""Protocol of a network host, its reported state, its address and its key."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from printctl.machine.errors import PortError
from printctl.machine.ports.detection import ENCRYPTED, NETWORK_HOSTS

KEY_VARIABLE: Final = "PRINTCTL_HOST_KEY"
KEY_FILE_VARIABLE: Final = "PRINTCTL_HOST_KEY_FILE"
_DEFAULT_PORT: Final = {"moonraker": 7125, "octoprint": 5000, "duet": 80}
_HTTPS_PORT: Final = 443
_ADDRESS: Final = re.compile(
    r"(?P<host>\[[0-9a-fA-F:.]+\]|[\w-]{1,63}(\.[\w-]{1,63})*\.?)(?::(?P<port>\d{1,5}))?/?",
    re.ASCII,
)
_MAX_KEY_BYTES: Final = 4096


class HostState(StrEnum):
    """State of a printer and its file, as its host reports it."""

    IDLE = "idle"
    """No file is selected, or another one than the print's."""
    READY = "ready"
    """The file is selected, and its first line wasn't run."""
    PRINTING = "printing"
    PAUSING = "pausing"
    PAUSED = "paused"
    RESUMING = "resuming"
    FINISHING = "finishing"
    """The file was read to its end; motors may still move."""
    CANCELLING = "cancelling"
    COMPLETE = "complete"
    CANCELLED = "cancelled"
    FAILED = "failed"
    HALTED = "halted"
    """The firmware has halted (emergency stop, or a fault of its own)."""
    OFFLINE = "offline"
    """The host answers, and has no connection to its printer."""


RUNNING: Final = frozenset(
    {HostState.PRINTING, HostState.PAUSING, HostState.PAUSED, HostState.RESUMING}
)
"""States in which lines of a file are ahead."""
ACTIVE: Final = RUNNING | {HostState.FINISHING, HostState.CANCELLING}
"""States in which a file's lines are run, or will be."""
OVER: Final = frozenset({HostState.COMPLETE, HostState.CANCELLED, HostState.FAILED})


@dataclass(frozen=True)
class HostReport:
    """One answer of a host about its printer.

    Attributes
    ----------
    state : HostState
    file : str
        Name of the file that the state is about; empty for none.
    position : int or None, bytes
        How far the file was read. What was read isn't made yet.
    progress : float or None
        As the host counts it, 0 to 1.
    message : str
        The host's own words, for a fault.
    place : (x, y, z) or None, mm
        Where the host says that the tip is; None where it doesn't.
    begun_s : float or None, s
        When the file was begun, by the host's clock; None where it doesn't say.
    moving : bool
        Whether the host says that moves which it has planned aren't made yet.
    """

    state: HostState
    file: str = ""
    position: int | None = None
    progress: float | None = None
    message: str = ""
    place: tuple[float, float, float] | None = None
    begun_s: float | None = None
    moving: bool = False

    def __post_init__(self) -> None:
        """Raise TypeError where a host gave something else for a number."""
        for number in (self.position, self.progress, self.begun_s, *(self.place or ())):
            if number is not None:
                math.isfinite(number)

    @property
    def active_file(self) -> str:
        """Name of the file whose lines are run, or will be; empty for none."""
        return (self.file or "another file") if self.state in ACTIVE else ""

    def without_nonsense(self, size: int) -> HostReport:
        """Return the report without what neither a tip nor a file of ``size`` bytes can have."""
        sound = self.progress is not None and 0.0 <= self.progress <= 1.0
        inside = self.position is not None and 0 <= self.position <= size
        return replace(
            self,
            progress=self.progress if sound else None,
            position=self.position if inside else None,
            place=self.place if all(map(math.isfinite, self.place or (math.nan,))) else None,
        )


class HostEnd(NamedTuple):
    """How a host's job history says that a file ended.

    ``state`` is None where the history has the file as begun and its end isn't known; ``ends`` is
    how many prints of the file have ended, of those that the history keeps.
    """

    state: HostState | None
    message: str = ""
    ends: int = 1


class StoredFile(NamedTuple):
    """A file as the host has stored it; ``sha1`` and ``sha256`` hex, empty where not reported."""

    size: int
    sha1: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class HostRequest:
    """One HTTP request; the body goes with its headers."""

    method: str
    path: str
    body: bytes = b""
    headers: dict[str, str] = field(default_factory=dict)


class PrintHost(Protocol):
    """A host that stores a file and runs it by itself.

    One thread uses an object. Every call ends within its time limit: `HostSilent` without an
    answer, `HostRefused` where the host says no.

    Attributes
    ----------
    begun : bool
        Set by the user where the file is known to have begun: not every host says so afterwards.
    """

    begun: bool

    @property
    def answered_at(self) -> float:
        """When the host answered last, s by `time.monotonic`."""

    def identify(self) -> str:
        """Return the host's program and version; log in where the host wants that."""

    def upload(self, name: str, data: bytes, check: Callable[[float], None]) -> None:
        """Store a file; ``check`` is called with the share sent and may raise to end it."""

    def stored(self, name: str, data: bytes) -> StoredFile:
        """Return what the host has stored under a name; ``data`` is what should be, or nothing."""

    def select(self, name: str) -> None:
        """Select a file without starting it; nothing moves."""

    def start(self, name: str) -> None:
        """Start the file of that name, whichever is selected; refused where there is none."""

    def delete(self, name: str) -> None:
        """Delete a stored file that isn't selected: a start of it is refused from then on."""

    def pause(self, name: str) -> None:
        """Pause the print."""

    def resume(self, name: str) -> None:
        """Go on after a pause."""

    def cancel(self, name: str) -> None:
        """End the print in the host's own way."""

    def close(self) -> None:
        """Let go of the connection."""

    def halt_request(self) -> HostRequest:
        """Return the request that halts the firmware; nothing is sent."""

    def state(self, name: str) -> HostReport:
        """Return what the host reports now, seen from the print of ``name``."""

    def active_file(self, name: str) -> str:
        """Return the name of the file whose lines are run, by one question; empty for none."""

    def ended(self, name: str) -> HostEnd | None:
        """Return how the host's job history has a file's print; None where it has none."""


class HostAddress(NamedTuple):
    """Where a host listens."""

    kind: str
    host: str
    port: int
    encrypted: bool = False

    @property
    def authority(self) -> str:
        """Host and port as in a URL, an IPv6 address in brackets."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    def __str__(self) -> str:
        return f"{self.kind}{ENCRYPTED * self.encrypted}://{self.authority}"


def parse_address(port: str) -> HostAddress:
    """Read a port such as ``moonraker://host:7125``; PortError for another one."""
    kind, _, rest = port.partition("://")
    scheme = kind.lower()
    kind, encrypted = scheme.removesuffix(ENCRYPTED), scheme.endswith(ENCRYPTED)
    match = _ADDRESS.fullmatch(rest)
    if "@" in rest or "?" in rest:
        raise PortError(
            f"port {scheme}://... holds a user, a password or a query; give {scheme}://HOST:PORT, "
            f"and the key by the environment ({KEY_VARIABLE}) or a file (--host-key)"
        )
    if kind not in NETWORK_HOSTS or match is None or int(match["port"] or 1) > 65535:
        raise PortError(
            f"port {port!r} isn't {', '.join(f'{one}://HOST[:PORT]' for one in NETWORK_HOSTS)}"
        )
    usual = _HTTPS_PORT if encrypted else _DEFAULT_PORT[kind]
    return HostAddress(kind, match["host"].strip("[]"), int(match["port"] or usual), encrypted)


def read_key(key_file: str = "") -> str:
    """Return the host's key or password: of the environment, else of a file; empty for none.

    The environment's file (`KEY_FILE_VARIABLE`) comes before ``key_file``, which is the one that
    the print was started with. PortError for a file that can't be read.
    """
    if text := os.environ.get(KEY_VARIABLE, "").strip():
        return _plain(text, KEY_VARIABLE)
    path = os.environ.get(KEY_FILE_VARIABLE) or key_file
    if not path:
        return ""
    try:
        text = Path(path).read_bytes()[:_MAX_KEY_BYTES].decode("ascii").strip()
    except (OSError, ValueError) as exc:
        raise PortError(f"the host's key file {path} can't be read: {type(exc).__name__}") from None
    return _plain(text, path)


def _plain(key: str, place: str) -> str:
    """Return a key that can stand in a header; PortError, without it, for another one."""
    if not (key.isascii() and key.isprintable()) or " " in key:
        raise PortError(f"the host's key ({place}) must be one line, the key alone")
    return key
