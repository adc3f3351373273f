"""Write 3MF, which unlike STL knows its unit.

3MF Core Specification 1.3 (3MF Consortium): a zip archive (OPC) of a content-type list, a
relationship that points to the model, and the model in XML. Written here rather than by trimesh,
whose exporter puts random UUIDs and the time of day into the file: the same design must give the
same bytes.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np

from design.files import write_bytes
from design.solids.solid import Solid

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

_MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US"
 xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<metadata name="Application">printctl</metadata>
<resources>
<object id="1" type="model"><mesh>
<vertices>
{vertices}</vertices>
<triangles>
{triangles}</triangles>
</mesh></object>
</resources>
<build><item objectid="1"/></build>
</model>
"""

_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest time a zip archive can hold; no clock is read."""


def write_3mf(path: Path, solid: Solid) -> None:
    """Write ``solid`` as one 3MF object in mm, the same bytes for the same solid.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    # Nine digits give back every float32.
    vertices = '<vertex x="%.9g" y="%.9g" z="%.9g"/>\n' * len(solid.vertices)
    triangles = '<triangle v1="%d" v2="%d" v3="%d"/>\n' * len(solid.faces)
    model = _MODEL.format(
        vertices=vertices % tuple(solid.vertices.astype(np.float32).ravel().tolist()),
        triangles=triangles % tuple(solid.faces.ravel().tolist()),
    )
    parts = {
        "[Content_Types].xml": _CONTENT_TYPES,
        "_rels/.rels": _RELATIONSHIPS,
        "3D/3dmodel.model": model,
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in parts.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(entry, text)
    write_bytes(path, archive.getvalue())
