"""Test scan files written byte by byte from the formats' specifications."""

import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration import Scan, ScanOverrides

MODALITY = ScanOverrides(modality="microct", scale="linear")
OCT = ScanOverrides(
    modality="oct", scale="linear", refractive_index=1.34, optical_depth=True, depth_down=True
)


def counts(nz: int = 9, ny: int = 8, nx: int = 7) -> NDArray[np.uint16]:
    """A volume in which every voxel differs, as z, y, x."""
    return np.arange(nz * ny * nx, dtype=np.uint16).reshape(nz, ny, nx)


def scan(**changes: Any) -> Scan:
    known: dict[str, Any] = {
        "volume": counts(), "voxel_mm": (0.02, 0.03, 0.031), "refractive_index": 1.34,
        "optical_depth": True, "scale": "linear", "modality": "oct", "depth_down": True,
        "came_from": Path("x"),
    }  # fmt: skip
    return Scan(**(known | changes))


def thorlabs(
    path: Path,
    volume: NDArray[Any],
    *,
    spacing: tuple[float, float, float] = (0.003, 0.012, 0.010),
    extent: tuple[float, float, float] | None = None,
    index: str | None = "1.0",
    folder: str = "data\\",
    header: str | None = None,
    extra: str = "",
    compression: int = zipfile.ZIP_STORED,
    bytes_per_pixel: str | None = "4",
    members: dict[str, bytes] | None = None,
) -> Path:
    """A `.oct` file of a (z, y, x) volume; spacing and extent as z, y, x."""
    nz, ny, nx = volume.shape
    size = extent or tuple(n * s for n, s in zip(volume.shape, spacing, strict=True))
    about = f'BytesPerPixel="{bytes_per_pixel}"' if bytes_per_pixel else ""
    acquired = f"<RefractiveIndex>{index}</RefractiveIndex>" if index is not None else ""

    def row(name: str, z: float, y: float, x: float) -> str:
        inner = f"<SizeZ>{z}</SizeZ><SizeX>{x}</SizeX><SizeY>{y}</SizeY>"
        return f"<{name}>{inner}</{name}>"

    text = header or (
        f'<?xml version="1.0" encoding="utf-8"?><Ocity><Acquisition>{acquired}</Acquisition>'
        f'<Image Type="Processed">{row("SizePixel", nz, ny, nx)}{row("SizeReal", *size)}'
        f"{row('PixelSpacing', *spacing)}</Image>{extra}<DataFiles>"
        f'<DataFile Type="Colored">data\\VideoImage.data</DataFile>'
        f'<DataFile Type="Real" SizeZ="{nz}" SizeX="{nx}" SizeY="{ny}" {about}>'
        f"data\\Intensity.data</DataFile></DataFiles></Ocity>"
    )
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr("Header.xml", text)
        info = zipfile.ZipInfo("x")
        info.filename = folder + "Intensity.data"
        info.compress_type = compression
        archive.writestr(info, np.ascontiguousarray(volume.transpose(1, 2, 0)).tobytes())
        for name, data in (members or {}).items():
            archive.writestr(name, data)
    return path


def bioptigen(path: Path, volume: NDArray[np.uint16], *, frames: int | None = None) -> Path:
    """A Bioptigen `.OCT` of a (z, y, x) volume: 2 × 3 × 1.5 mm as x, y, depth."""
    nz, ny, nx = volume.shape

    def record(key: str, value: bytes) -> bytes:
        return struct.pack("<I", len(key)) + key.encode() + struct.pack("<I", len(value)) + value

    def whole(key: str, value: int) -> bytes:
        return record(key, struct.pack("<I", value))

    def real(key: str, value: float) -> bytes:
        return record(key, struct.pack("<d", value))

    out = struct.pack("<HHH", 0x5678, 0x1234, 0x101)
    out += struct.pack("<I", 11) + b"FRAMEHEADER" + struct.pack("<I", 0)
    out += whole("FRAMECOUNT", frames or ny) + whole("LINECOUNT", nx) + whole("LINELENGTH", nz)
    out += whole("SAMPLEFORMAT", 1) + record("DESCRIPTION", b"a gel") + real("XMIN", 0.0)
    out += whole("SCANTYPE", 1) + real("SCANDEPTH", 1.5) + real("SCANLENGTH", 2.0)
    out += real("AZSCANLENGTH", 2.0) + real("ELSCANLENGTH", 3.0)
    out += whole("SCANS", 1) + whole("FRAMES", frames or ny) + whole("DOPPLERFLAG", 0)
    out += record("CONFIG", b"\0" * 300) + struct.pack("<I", 0)
    for y in range(ny):
        out += struct.pack("<I", 9) + b"FRAMEDATA" + struct.pack("<I", 0)
        out += record("FRAMEDATETIME", b"\0" * 16) + real("FRAMETIMESTAMP", 0.1 * y)
        out += whole("FRAMELINES", nx)
        out += record("FRAMESAMPLES", volume[:, y, :].T.tobytes()) + struct.pack("<I", 0)
    path.write_bytes(out)
    return path


def heidelberg(
    path: Path, volume: NDArray[np.float32], *, upwards: bool = False, pattern: int = 3
) -> Path:
    """A `.vol` of a (z, y, x) volume: 0.004 × 0.05 × 0.011 mm as z, y, x."""
    nz, ny, nx = volume.shape
    head = bytearray(2048)
    struct.pack_into("<12s3I3d2I", head, 0, b"HSF-OCT-103\0", nx, ny, nz, 0.011, 0.05, 0.004, 5, 4)
    struct.pack_into("<iI", head, 96, pattern, 256 + 4 * nx)
    out = bytes(head) + b"\7" * 20
    for y in range(ny):
        own = bytearray(256 + 4 * nx)
        at = 0.05 * (ny - y if upwards else y)
        struct.pack_into("<12sI4d", own, 0, b"HSF-BS-103\0", len(own), 0.0, at, 0.011 * nx, at)
        out += bytes(own) + volume[:, y, :].astype("<f4").tobytes()
    path.write_bytes(out)
    return path
