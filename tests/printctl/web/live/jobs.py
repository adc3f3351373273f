"""Test jobs for the live view."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

from printctl.web.live import JobSource

HEAD = b"G21\nG90\nM82\nG92 X0 Y0 Z0.2 E0\n"


def source(folder: Path, gcode: bytes, **more: object) -> JobSource:
    path = folder / "job.gcode"
    path.write_bytes(gcode)
    return JobSource(path, folder / "cache", **more)  # type: ignore[arg-type]


def squares(layers: int, laps: int = 3) -> bytes:
    """Square spirals, a layer each, with a lift and a travel in between."""
    lines, dose = [HEAD.decode()], 0.0
    for layer in range(layers):
        z = 0.2 + 0.2 * layer
        lines.append(f"; layer {layer}\nG0 X0 Y0 Z{z + 1:.3f} F3000\nG0 Z{z:.3f}\n\n")
        for lap in range(laps):
            a, b = lap * 0.8, 10 - lap * 0.8
            for x, y in ((b, a), (b, b), (a, b), (a, a + 0.8)):
                dose += 0.03
                lines.append(f"G1 X{x:.3f} Y{y:.3f} E{dose:.5f} F600 ; side\n")
    return "".join(lines).encode()


# --- live view scene in plain Python: slow oracle
class Move(NamedTuple):
    command: int
    end: tuple[float, float, float]
    writes: bool


def moves_of(gcode: bytes) -> list[Move]:
    """Straight moves of an absolute file in mm that begins with a G92 of all axes."""
    at, dose, found, command = [0.0, 0.0, 0.0], 0.0, [], -1
    for raw in gcode.decode().splitlines():
        words = raw.partition(";")[0].split()
        if not words:
            continue
        command += 1
        said = {word[0]: float(word[1:]) for word in words[1:]}
        if words[0] == "G92":
            at, dose = [said[axis] for axis in "XYZ"], said["E"]
        if words[0] not in ("G0", "G1"):
            continue
        end = [said.get(axis, old) for axis, old in zip("XYZ", at, strict=True)]
        rises = said.get("E", dose) > dose
        if end != at:
            found.append(Move(command, (end[0], end[1], end[2]), rises))
        at, dose = end, said.get("E", dose)
    return found


def read_packed(data: bytes) -> tuple[bytes, list[tuple[int, ...]], list[int], list[float]]:
    """Header, points, commands and times of packed bytes, number by number."""
    assert data[:8] == b"PRINTVIW"
    version, size = struct.unpack_from("<II", data, 8)
    assert version == 1
    at = 16 + size
    header = data[16:at]
    moves = (len(data) - at - 16) // 24
    points = [struct.unpack_from("<8H", data, at + 16 * i) for i in range(moves + 1)]
    at += 16 * (moves + 1)
    commands = [struct.unpack_from("<I", data, at + 4 * i)[0] for i in range(moves)]
    times = [struct.unpack_from("<f", data, at + 4 * (moves + i))[0] for i in range(moves)]
    return header, points, commands, times
