"""Test jobs for the live view."""

from __future__ import annotations

from pathlib import Path

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
