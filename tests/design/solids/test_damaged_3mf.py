"""3MF files that are damaged, or say what isn't read: refused with the reason."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from design.errors import SolidError
from design.solids import block_solid, read_solid, write_3mf

MODEL = "3D/3dmodel.model"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('v2="5"', 'v2="-1"', "corner that isn't there"),
        ('v2="5"', f'v2="{2**32 + 5}"', "corner that isn't there|not a readable 3MF"),
        ('v2="5"', 'v2="99999999999999999999"', "corner that isn't there|not a readable 3MF"),
        ("</model>", "", "not a readable 3MF file"),
        ('unit="millimeter"', 'unit="foot"', "the file's unit is foot"),
    ],
)
def test_it_is_refused_with_the_reason(tmp_path: Path, old: str, new: str, why: str) -> None:
    path = tmp_path / "one.3mf"
    write_3mf(path, block_solid((1, 1, 1)))
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert old.encode() in files[MODEL]
    files[MODEL] = files[MODEL].replace(old.encode(), new.encode(), 1)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    with pytest.raises(SolidError, match=why):
        read_solid(path, None)


def test_a_model_elsewhere_in_the_archive_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "one.3mf"
    write_3mf(path, block_solid((1, 1, 1)))
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name.replace("3D/3dmodel", "Models/foo"), data)
    with pytest.raises(SolidError, match="not a readable 3MF file"):
        read_solid(path, None)
