"""Small test job for the G-code page: two layers of four lines, and three passes."""

import numpy as np

from report.gcode import Act, GcodeJob, Layers

TRAVEL, LIFTED, WRITE = Act.TRAVEL, Act.LIFTED, Act.WRITE


def make_job(places, acts, layer, layers, **more):
    """A job whose moves go through ``places`` (n + 1, 3); a move's line is its number plus 11."""
    places, acts = np.asarray(places, float), np.array(acts, np.uint8)
    count = len(acts)
    writes = acts == WRITE
    dosed = writes | np.isin(acts, (Act.PRIME, Act.RETRACT))
    text = "".join(f"G1 line {k + 1}\n" for k in range(count + 10)).encode()
    given = {
        "name": "job.gcode",
        "start": places[:-1],
        "end": places[1:],
        "act": acts,
        "dose_ul": np.where(dosed, np.where(acts == Act.RETRACT, -0.25, 0.5), 0.0),
        "width_mm": np.where(writes, 0.5, np.nan),
        "speed_mm_s": np.full(count, 20.0),
        "time_s": np.full(count, 0.25),
        "line": np.arange(count) + 11,
        "kind": np.where(np.arange(count) % 2 == 0, 0, 1),
        "kinds": ("External perimeter", "Solid infill"),
        "vessel": None,
        "layer": np.asarray(layer),
        "layers": layers,
        "text": text,
        "notes": ("A note.",),
    }
    return GcodeJob(**{**given, **more})


def layered_job(**more):
    """Lines at y = 1, 2 (layer 1, z 0.06) and at y = 1, 2 (layer 2, z 0.12), 10 mm long each."""
    places = [
        (0, 0, 5), (0, 1, 0.06), (10, 1, 0.06), (10, 2, 0.06), (0, 2, 0.06),
        (0, 2, 0.06), (0, 1, 0.12), (0, 1, 0.12), (10, 1, 0.12), (10, 2, 0.12), (0, 2, 0.12),
    ]  # fmt: skip
    acts = [LIFTED, WRITE, TRAVEL, WRITE, Act.RETRACT, LIFTED, Act.PRIME, WRITE, TRAVEL, WRITE]
    layers = Layers(False, np.array([0.06, 0.12]), np.array([0.06, 0.06]))
    return make_job(places, acts, [0, 0, 0, 0, 1, 1, 1, 1, 1, 1], layers, **more)


def passes_job(**more):
    """Three slanted passes."""
    places = [(0, 0, 1), (5, 0, 3), (5, 0, 6), (5, 5, 6), (5, 5, 1), (0, 5, 2), (0, 5, 6),
              (2, 5, 6), (2, 5, 2), (2, 2, 4)]  # fmt: skip
    acts = [WRITE, LIFTED, LIFTED, LIFTED, WRITE, LIFTED, LIFTED, LIFTED, WRITE]
    layers = Layers(True, np.array([3.0, 2.0, 4.0]), np.full(3, np.nan))
    vessel = np.array([7, 7, 7, 7, 8, 8, 8, 8, 9])
    more = {"vessel": vessel, **more}
    return make_job(places, acts, [0, 1, 1, 1, 1, 2, 2, 2, 2], layers, **more)
