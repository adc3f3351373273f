import base64
import zlib
from dataclasses import fields

import numpy as np
import pytest

from registration.report import ReportError, write_report_html
from registration.report.gcode import Act
from registration.report.play import (
    PlayRows,
    load_played,
    play_section,
    save_played,
)
from registration.report.play.serialise import pack_playback

from .play_sample import layered, passes


def values(text, kind):
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), kind)


def decoded(data):
    """Columns of a page's rows, the slow way."""
    places = data["places"]
    steps = values(places["positions"], "<u2").reshape(-1, 3).astype(int)
    levels = np.cumsum(steps, axis=0) % 65536
    found = {
        "place": np.array(places["low"]) + levels * np.array(places["step"]),
        "time": np.cumsum(values(data["time_ms"], "<i4")) / 1e3,
        "laid": np.cumsum(values(data["laid"], "<i4")) * data["laid_step_ul"],
        "act": values(data["act"], "u1"),
        "head": values(data["head"], "u1"),
    }
    for name in ("line", "layer", "vessel"):
        found[name] = np.cumsum(values(data[name], "<i4"))
    for name in ("width", "wanted"):
        um = values(data[f"{name}_um"], "<u2").astype(float)
        found[name] = np.where(um == 65535, np.nan, um / 1e3)
    assert {len(column) for column in found.values()} == {data["rows"]}
    return found


@pytest.mark.parametrize("played", [layered(), passes()], ids=["layers", "passes"])
def test_what_a_page_holds_is_the_prediction(played):
    rows, data = played.rows, pack_playback(played)
    found = decoded(data)
    own = found["act"] != Act.JUMP
    begins = np.flatnonzero(own) - 1
    for column, wanted, off in (
        (found["place"][own], rows.end, 1e-4),
        (found["place"][begins], rows.start, 1e-4),
        (found["time"][own], rows.end_s, 5e-4),
        (found["time"][begins], rows.begin_s, 5e-4),
        (found["laid"][own], rows.laid_ul, rows.laid_ul[-1] * 5e-7),
        (found["width"][own], rows.width_mm, 5e-4),
        (found["wanted"][own], rows.wanted_mm, 5e-4),
    ):
        np.testing.assert_allclose(column, wanted, atol=1.001 * off)
    for name in ("act", "line", "layer", "vessel", "head"):
        assert found[name][own].tolist() == getattr(rows, name).tolist()
    assert np.all(np.diff(found["time"]) >= 0)
    # One where the job begins, and one where the layered job rests for 2 s.
    assert (~own).sum() == (1 if played.passes else 2)


def test_a_file_between_keeps_all(tmp_path):
    played = passes()
    save_played(tmp_path / "a.npz", played)
    save_played(tmp_path / "b.npz", played)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = load_played(tmp_path / "a.npz")
    for one in fields(PlayRows):
        np.testing.assert_array_equal(getattr(again.rows, one.name), getattr(played.rows, one.name))
    assert (again.inks, again.warnings, again.passes) == (played.inks, played.warnings, True)
    (tmp_path / "b.npz").write_bytes(b"no")
    with pytest.raises(ReportError, match="isn't a prediction"):
        load_played(tmp_path / "b.npz")


def test_a_report_has_a_slider_only_with_a_prediction(tmp_path):
    path = tmp_path / "r.html"
    write_report_html(path, {"recipe": "one"}, [], None)
    without = path.read_text(encoding="utf-8")
    assert "play-viewer" not in without
    assert "play/main" not in without
    write_report_html(path, {"recipe": "one"}, [], None, None, play_section(passes()))
    text = path.read_text(encoding="utf-8")
    assert text.count('id="play-data"') == text.count('id="play-viewer"') == 1
    assert '<a href="#play">' in text
    assert "<script>document" not in text
