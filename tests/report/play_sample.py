"""Small test prediction for the playback page: two layers, and three passes of two inks."""

import numpy as np

from report.gcode import Act
from report.play import Playback, PlayNote, PlayRows

HOSTILE = "</script><script>document.title='taken'</script>"


def make_rows(places, times, act, **more):
    """Stretches between places (n + 1, 3) at times (n + 1,); a stretch's line is its number + 5."""
    places, times = np.asarray(places, float), np.asarray(times, float)
    act = np.asarray(act, np.uint8)
    n = len(act)
    writes = act == Act.WRITE
    given = {
        "start": places[:-1],
        "end": places[1:],
        "begin_s": times[:-1],
        "end_s": times[1:],
        "act": act,
        "laid_ul": np.cumsum(np.where(writes, 0.5, 0.0)),
        "width_mm": np.where(writes, 0.2, np.nan),
        "wanted_mm": np.where(writes, 0.25, np.nan),
        "line": np.arange(n) + 5,
        "vessel": np.full(n, -1),
        "head": np.zeros(n, np.int64),
        "layer": np.zeros(n, np.int64),
    }
    return PlayRows(**{**given, **more})


def layered(**more):
    """Two lines in each of two layers; the time stands still for 2 s between them (a jump)."""
    places = [(0, 0, 1), (10, 0, 1), (10, 1, 1), (0, 1, 1), (0, 1, 2), (10, 1, 2), (10, 3, 2),
              (0, 3, 2)]  # fmt: skip
    act = [Act.WRITE, Act.TRAVEL, Act.WRITE, Act.TRAVEL, Act.WRITE, Act.TRAVEL, Act.WRITE]
    rows = make_rows(places, np.arange(8.0), act, layer=np.array([0, 0, 0, 1, 1, 1, 1]))
    late = np.array([0, 0, 0, 2, 2, 2, 2.0])
    rows = make_rows(places, np.arange(8.0), act, layer=rows.layer,
                     begin_s=rows.begin_s + late, end_s=rows.end_s + late)  # fmt: skip
    said = {
        "rows": rows,
        "passes": False,
        "layer_z_mm": np.array([1.0, 2.0]),
        "inks": ("Gel",),
        "wanted": "the design",
        "warnings": (PlayNote("much too thin", 9, 7.0), PlayNote("all of it", 0, None)),
    }
    return Playback(**{**said, **more})


def passes(**more):
    """Three slanted passes, the last with another head."""
    places = [(0, 0, 1), (5, 0, 3), (5, 5, 6), (0, 5, 2), (0, 5, 6), (2, 2, 4)]
    act = [Act.WRITE, Act.TRAVEL, Act.WRITE, Act.TRAVEL, Act.WRITE]
    own = {
        "layer": np.array([0, 1, 1, 2, 2]),
        "vessel": np.array([4, -1, 5, -1, 6]),
        "head": np.array([0, 0, 0, 1, 1]),
    }
    rows = make_rows(places, np.arange(6.0), act, **own)
    said = {
        "rows": rows,
        "passes": True,
        "layer_z_mm": np.array([3.0, 6.0, 6.0]),
        "inks": ("Gel", HOSTILE),
        "wanted": "the design",
    }
    return Playback(**{**said, **more})
