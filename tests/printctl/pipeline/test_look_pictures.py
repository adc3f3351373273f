"""Strip and curve of the looks at a print, for the report."""

from __future__ import annotations

import io
import math
from pathlib import Path

from lxml import etree
from PIL import Image

from printctl.machine.link.inserts import Insert
from printctl.machine.link.journal import encode
from printctl.machine.link.record import JOURNAL
from printctl.observe.records import LookRecord, look_folder, save_look
from printctl.pipeline.look_pictures import look_pictures, look_rows


def record(number: int, decision: str = "go_on", coverage: float | None = 1.0) -> LookRecord:
    found = {"coverage": coverage, "seen_share": None if coverage is None else 0.9}
    return LookRecord(number, 9, 9, "end of layer 1", 100.0, decision, "why", found=found)


def test_rows_tell_what_the_journal_says_was_done() -> None:
    """A proposed mend that never came into the job isn't one."""
    looks = [record(1, "mend"), record(2, "pause", None), record(3), record(4, "pause")]
    inserts = [
        Insert(1, 9, (b"G1 X1",)),
        Insert(3, 30, (), "drift", 1.1),
        Insert(4, 40, (b"G4",), "", 1.1),
    ]
    rows = look_rows(looks, inserts)
    assert [row.mended for row in rows] == [True, False, False, True]
    assert [row.flow for row in rows] == [None, None, 1.1, None]
    assert [row.held for row in rows] == [False, True, False, False]
    assert math.isnan(rows[1].ink)
    assert math.isnan(rows[1].seen)


def test_strip_and_curve_of_a_print_folder(tmp_path: Path) -> None:
    assert look_pictures(tmp_path) == {}
    job = {"t": "job", "sha256": "0" * 64, "lines": 30, "started": 50.0}
    insert = {"t": "insert", "reload_at": [], **Insert(2, 20, (b"G1 X1", b"G4 P0")).to_record()}
    (tmp_path / JOURNAL).write_bytes(encode(job) + encode(insert))
    old = LookRecord(4, 9, 9, "of an earlier print", 10.0, "stop", "why")
    for one in (record(1), record(2, "mend", 0.8), record(3, "pause", None), old):
        save_look(tmp_path, one)
    Image.new("RGB", (300, 200), "#8090a0").save(look_folder(tmp_path, 1) / "seen.png")
    Image.new("L", (200, 300), 90).save(look_folder(tmp_path, 2) / "picture.png")
    (look_folder(tmp_path, 3) / "seen.png").write_bytes(b"torn")
    found = look_pictures(tmp_path)
    curve, strip = found.values()
    assert [name.startswith("print/") for name in found] == [True, True]
    assert "3 looks in their order" in list(found)[1]
    assert {"mended", "paused or stopped"} <= set(etree.fromstring(curve).itertext())
    with Image.open(io.BytesIO(strip)) as picture:
        assert picture.width == 3 * picture.height
        edges = [picture.convert("RGB").getpixel((k * picture.height + 1, 100)) for k in range(3)]
    greys, blue, red = edges
    assert max(greys) - min(greys) < 30
    assert blue[2] > blue[0] + 60
    assert red[0] > red[2] + 60
