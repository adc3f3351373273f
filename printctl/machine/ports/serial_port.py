"""Read and write a printer's serial port: USB-CDC, UART or pseudo-terminal.

pyserial opens and configures it (exclusive, raw). On POSIX systems reading and writing then go
straight to the descriptor, which costs a third of pyserial's own calls; elsewhere (Windows)
pyserial does both.

The hang-up flag is off, so that closing the port (a crashed host, too) leaves DTR as it is: on
boards that reset when DTR rises, the next program that opens the port doesn't reset them.
"""

from __future__ import annotations

import errno
import os
import select
import sys
import threading
import time
from contextlib import suppress
from typing import Final

import serial

from printctl.machine.errors import PortDenied, PortError, PortInUse, PortLost, PortMissing
from printctl.machine.ports.detection import PortPrograms, list_ports, programs_at

if sys.platform != "win32":
    import fcntl
    import termios

    termios_error: type[Exception] = termios.error
else:
    termios_error = OSError

WRITE_LIMIT_S: Final = 5.0
CHUNK_BYTES: Final = 65536
_RESET_PULSE_S: Final = 0.25
_TERMINALS: Final = "/dev/pts/"
"""Of programs: a simulated printer's port is one."""


def _refusal(name: str, exc: OSError) -> PortError:
    text = str(exc)
    if exc.errno == errno.ENOENT or "FileNotFound" in text:
        if name.startswith(_TERMINALS):
            return PortMissing(
                f"port {name} doesn't exist any more: it was a simulated printer's, which has "
                "ended; what it had printed is gone with it, so print anew"
            )
        ports = ", ".join(info.device for info in list_ports()) or "none"
        return PortMissing(
            f"port {name} doesn't exist (ports found: {ports}); check the cable and the power, or "
            "give another --port"
        )
    if exc.errno in (errno.EACCES, errno.EPERM):
        return PortDenied(
            f"no permission to open {name}; add yourself to its group (`sudo usermod -aG dialout "
            "$USER`, then log in again) or add a udev rule"
        )
    if exc.errno in (errno.EAGAIN, errno.EBUSY) or "lock" in text or "PermissionError" in text:
        return PortInUse(f"port {name} is held by another program; close it there and try again")
    return PortError(f"port {name} can't be opened: {text}; check that it is a serial port")


class SerialTransport:
    """Connection by a serial port; see `printctl.machine.ports.transport.Transport`.

    ``dtr`` and ``rts`` are the state of the modem lines while the port is open. On Linux opening
    raises both all the same; a line that should be low falls at once. Raises `PortError`.
    """

    quiet_s: float = 0.05
    stolen: int = 0

    def __init__(self, name: str, baud: int, dtr: bool = True, rts: bool = True) -> None:
        self.name = name
        self._out, self._halting = threading.Lock(), False
        try:
            self._serial = serial.Serial(
                None, baud, timeout=0, write_timeout=WRITE_LIMIT_S, exclusive=True
            )
            self._serial.port, self._serial.dtr, self._serial.rts = name, dtr, rts
            self._serial.open()
        except (OSError, ValueError) as exc:
            raise _refusal(name, exc if isinstance(exc, OSError) else OSError(str(exc))) from exc
        self._fd = -1 if sys.platform == "win32" else self._serial.fileno()
        if self._fd >= 0:
            if sys.platform != "win32":  # closing leaves DTR as it is
                settings = termios.tcgetattr(self._fd)
                settings[2] &= ~termios.HUPCL
                termios.tcsetattr(self._fd, termios.TCSANOW, settings)
            self._keep_others_out(True)
            self._readable, self._writable = select.poll(), select.poll()
            self._readable.register(self._fd, select.POLLIN)
            self._writable.register(self._fd, select.POLLOUT)

    def _keep_others_out(self, out: bool) -> None:
        """Have the system refuse further programs; pyserial's lock binds those alone that look.

        The administrator's are let in all the same, and who has the port open already keeps it. On
        a pseudo-terminal it outlives a host that is killed, and would keep the next one out, too.
        """
        lasting = os.path.realpath(self.name).startswith(_TERMINALS)
        if sys.platform != "win32" and not (lasting and os.geteuid() != 0):
            with suppress(OSError):  # not every driver knows it
                fcntl.ioctl(self._fd, termios.TIOCEXCL if out else termios.TIOCNXCL)

    def programs(self) -> PortPrograms:
        """Find the other programs that have the port open; some 10 ms."""
        try:
            return programs_at(self._fd) if self._fd >= 0 else PortPrograms()
        except OSError:
            return PortPrograms(complete=False)

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        try:
            if self._fd < 0:
                self._serial.timeout = max(0.0, timeout)
                return bytes(self._serial.read(max(1, self._serial.in_waiting)))
            seen = self._readable.poll(max(0.0, timeout) * 1000.0)
            if not seen:
                return b""
            data = os.read(self._fd, CHUNK_BYTES)
            if not data and not seen[0][1] & ~select.POLLIN:
                self.stolen += 1  # there was something, and another reader has it
                return b""
        except BlockingIOError:
            self.stolen += 1
            return b""
        except (OSError, TypeError, ValueError) as exc:
            raise self._lost(exc) from exc
        if not data:
            raise PortLost(f"port {self.name} went away (end of file)")
        return data

    def _lost(self, exc: Exception) -> PortLost:
        return PortLost(f"port {self.name} went away: {exc}")

    def write(self, data: bytes) -> bool:
        """Write all of ``data``, or raise `PortLost` within `WRITE_LIMIT_S`; see `Transport`."""
        left = self._send(data)
        limit = time.monotonic() + WRITE_LIMIT_S if left else 0.0
        while left:
            if not self._writable.poll(max(0.0, limit - time.monotonic()) * 1000.0):
                raise PortLost(
                    f"port {self.name} took no byte for {WRITE_LIMIT_S:g} s; check the cable"
                )
            left = self._send(left)
        return left is not None

    def _send(self, data: bytes) -> bytes | None:
        """Write what the port takes now; return the rest, None once a halt has begun."""
        with self._out:
            if self._halting:
                return None
            try:
                if self._fd < 0:
                    self._serial.write(data)
                    return b""
                return data[os.write(self._fd, data) :]
            except BlockingIOError:
                return data
            except (OSError, TypeError, ValueError) as exc:
                raise self._lost(exc) from exc

    def write_urgent(self, data: bytes) -> bool:
        """Drop what hasn't left yet and write ``data`` at once; False as for `write`."""
        with self._out:
            if not self._halting:
                self._overtake(data)
            return not self._halting

    def write_halt(self, data: bytes) -> None:
        """Drop what hasn't left yet, write ``data`` at once, take nothing else; any thread."""
        self._halting = True
        if self._fd < 0:
            with suppress(OSError):  # there a write may wait, and holds the lock meanwhile
                self._serial.reset_output_buffer()
        with self._out:
            self._overtake(data)

    def _overtake(self, data: bytes) -> None:
        try:
            self._serial.reset_output_buffer()
            if self._fd < 0:
                self._serial.write(data)
            else:
                os.write(self._fd, data)
        except (OSError, TypeError, ValueError) as exc:
            raise self._lost(exc) from exc

    def set_baud(self, baud: int) -> None:
        """Change the rate while the port is open, and forget what came at another."""
        try:
            self._serial.baudrate = baud
            self._serial.reset_input_buffer()
        except (OSError, ValueError, termios_error) as exc:
            raise PortLost(f"port {self.name} can't be set to {baud} Bd: {exc}") from exc

    def reset(self) -> bool:
        """Pulse DTR, which resets most boards, and leave it as it was.

        What resets is the line's going up: False, then True. False on a port without modem lines.
        """
        try:
            before = self._serial.dtr
            self._serial.dtr = False
            time.sleep(_RESET_PULSE_S)
            self._serial.dtr = True
            if not before:
                time.sleep(_RESET_PULSE_S)
                self._serial.dtr = False
        except (OSError, ValueError):
            return False
        return True

    def close(self) -> None:
        """Let go of the port; closing twice does no harm."""
        with self._out:  # the number of a closed descriptor may be another file's
            if self._serial.is_open:
                self._keep_others_out(False)
            self._serial.close()
