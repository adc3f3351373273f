"""Write one or several solids as a 3MF file, with unit, names and colours.

3MF Core Specification 1.3 (3MF Consortium): a zip archive (OPC) of a content-type list, a
relationship that points to the model, and the model in XML. trimesh's exporter puts random UUIDs
and the time of day into the file, where the same design must give the same bytes.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape, quoteattr

from numpy.typing import NDArray

from design.errors import SolidError
from design.files import write_bytes
from design.solids.solid import Solid

METADATA: Final = (
    "Title",
    "Designer",
    "Description",
    "Copyright",
    "LicenseTerms",
    "Rating",
    "CreationDate",
    "ModificationDate",
)
"""Names that the core specification knows besides Application, which is always printctl."""

_CONTENT_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""

_RELATIONSHIPS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel0"
 Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US"
 xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
{metadata}<resources>
"""

_TAIL = """</resources>
<build>{items}</build>
</model>
"""

_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest time a zip archive can hold; no clock is read."""

DEFLATE_LEVEL: Final = 1
"""Of deflate: a quarter of the usual one's time, and files a quarter larger."""

BATCH_ROWS: Final = 4096
"""Formatted at a time: text of 200 kB."""

_COLOUR = re.compile(r"#[0-9A-Fa-f]{6}([0-9A-Fa-f]{2})?")


@dataclass(frozen=True)
class Part:
    """One object of a 3MF file.

    Attributes
    ----------
    solid : Solid
    name : str
    colour : str, optional
        ``#RRGGBB`` or ``#RRGGBBAA``, shown by slicers and viewers.
    """

    solid: Solid
    name: str = ""
    colour: str | None = None


def write_3mf(
    path: Path,
    solid: Solid | Sequence[Part],
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write a solid, or several named and coloured ones, in mm; the same bytes for the same.

    Parameters
    ----------
    path : Path
    solid : Solid or sequence of Part
        Parts share one frame, and may touch or overlap: each is an object of its own.
    metadata : mapping, optional
        See `METADATA`.

    Raises
    ------
    SolidError
        No part, a colour that isn't one, a name of metadata that 3MF doesn't know.
    OSError
        When the file can't be written.
    """
    parts = [Part(solid)] if isinstance(solid, Solid) else list(solid)
    items = "".join(f'<item objectid="{number + 2}"/>' for number in range(len(parts)))
    model = [
        _HEAD.format(metadata=_metadata(metadata or {})).encode(),
        *_resources(parts),
        _TAIL.format(items=items).encode(),
    ]
    files = {
        "[Content_Types].xml": [_CONTENT_TYPES.encode()],
        "_rels/.rels": [_RELATIONSHIPS.encode()],
        "3D/3dmodel.model": model,
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, pieces in files.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(entry, b"".join(pieces), compresslevel=DEFLATE_LEVEL)
    write_bytes(path, archive.getvalue())


def _metadata(given: Mapping[str, str]) -> str:
    unknown = sorted(set(given) - set(METADATA))
    if unknown:
        raise SolidError(f"3MF metadata {unknown[0]!r}: choose from {', '.join(METADATA)}")
    lines = {"Application": "printctl"} | dict(given)
    return "".join(
        f'<metadata name="{name}">{escape(text)}</metadata>\n' for name, text in lines.items()
    )


def _resources(parts: list[Part]) -> list[bytes]:
    """Colours (resource 1, where there are any) and objects (2 on)."""
    if not parts:
        raise SolidError("a 3MF file without parts; give at least one solid")
    colours = [part.colour for part in parts if part.colour is not None]
    for colour in colours:
        if not _COLOUR.fullmatch(colour):
            raise SolidError(f"colour {colour!r}: write it as #RRGGBB or #RRGGBBAA")
    resources: list[bytes] = []
    if colours:
        bases = "".join(
            f"<base name={quoteattr(part.name or 'part')} displaycolor={quoteattr(part.colour)}/>\n"
            for part in parts
            if part.colour is not None
        )
        resources.append(f'<basematerials id="1">\n{bases}</basematerials>\n'.encode())
    coloured = 0
    for number, part in enumerate(parts):
        extra = f" name={quoteattr(part.name)}" if part.name else ""
        if part.colour is not None:
            extra += f' pid="1" pindex="{coloured}"'
            coloured += 1
        resources += _object(number + 2, extra, part.solid)
    return resources


def _object(number: int, extra: str, solid: Solid) -> list[bytes]:
    # Nine digits give back every float32, but not to readers that hold doubles: faces would cross.
    return [
        f'<object id="{number}" type="model"{extra}><mesh>\n<vertices>\n'.encode(),
        *_rows(b'<vertex x="%.17g" y="%.17g" z="%.17g"/>\n', solid.vertices),
        b"</vertices>\n<triangles>\n",
        *_rows(b'<triangle v1="%d" v2="%d" v3="%d"/>\n', solid.faces),
        b"</triangles>\n</mesh></object>\n",
    ]


def _rows(row: bytes, values: NDArray[Any]) -> Iterator[bytes]:
    for first in range(0, len(values), BATCH_ROWS):
        batch = values[first : first + BATCH_ROWS]
        yield row * len(batch) % tuple(batch.ravel().tolist())
