"""Short print for the kill benchmark; every move's end is known."""

from __future__ import annotations

from typing import Final

import numpy as np

from benchmarks.link_files import START_MM, STEPS_PER_MM, PrintFile

_LAYERS: Final = 6
_MOVES: Final = 50
_SIDE: Final = 280
_ROW: Final = 20
_DOSE: Final = 22
_LAYER: Final = 100
_RELIEF: Final = 1600
_HEADER: Final = (b"M302 P1", b"G90", b"M82", b"M85 S600", b"G92 X50 Y50 Z10 E0")


def short_job(seed: int) -> PrintFile:
    """Return a job of some 300 moves in layers; ``ends`` holds the moves along X and Y alone.

    Other seeds give other files, so that no two prints share a hash.
    """
    start = np.round(np.array(START_MM) * STEPS_PER_MM[:3]).astype(np.int64)
    lines, ends, dose = [*_HEADER, b"; print %d" % seed], [], 0
    for layer in range(_LAYERS):
        z = start[2] + layer * _LAYER
        if layer:
            ends.append(np.array([start[0] + _SIDE // 2, start[1] - 40, z, dose - _RELIEF]))
            lines.append(_line("G0 X{0:.3f} Y{1:.3f} F6000", ends[-1]))
            lines.append(_line("G1 E{3:.5f} F60", np.array([0, 0, 0, dose])))
        for k in range(_MOVES):
            dose += _DOSE
            x = start[0] + (k + 1) % 2 * _SIDE
            ends.append(np.array([x, start[1] + k * _ROW, z, dose]))
            lines.append(_line("G1 X{0:.3f} Y{1:.3f} E{3:.5f} F1800", ends[-1]))
        lines.append(_line("G1 E{3:.5f} F60", np.array([0, 0, 0, dose - _RELIEF])))
        lines.append(_line("G0 Z{2:.3f} F300", np.array([0, 0, z + _LAYER, 0])))
        lines += [b";LAYER_END:%d" % layer, b";RELOAD"]
    return PrintFile([*lines, b"M400"], np.array(ends))


def _line(form: str, end: object) -> bytes:
    return form.format(*(np.asarray(end) / STEPS_PER_MM)).encode()
