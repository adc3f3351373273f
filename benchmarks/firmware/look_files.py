"""Files in layers for prints that are held for looks, and what is inserted in them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

LAYERS, MOVES = 3, 6
HEAD = ["M85 S600", "G21", "G90", "M82", "M302 P1", "G92 X50 Y50 Z10 E0", "G0 Z10.25 F300"]


@dataclass
class LayeredFile:
    """Random strokes in layers, each drawn back, lifted and marked at its end.

    Attributes
    ----------
    seed : int
    commands : list of str
        The file's, without its marks.
    ends : list of (int, dict)
        Commands before each layer's end, and the place there, mm.
    mends : dict
        By look, what was inserted there.
    """

    seed: int
    commands: list[str] = field(default_factory=lambda: list(HEAD))
    ends: list[tuple[int, dict[str, float]]] = field(default_factory=list)
    mends: dict[int, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng, e = np.random.default_rng(self.seed), 0.0
        for layer in range(LAYERS):
            z = 10.0 + 0.25 * layer
            x, y = self._place(100)
            self.commands += [f"G0 X{x:.2f} Y{y:.2f} F3000", f"G0 Z{z:.2f} F300", f"G1 E{e:.5f}"]
            for _ in range(MOVES):
                (x, y), e = self._place(100), e + 0.002 * int(self.rng.integers(8, 30))
                feed = int(self.rng.integers(900, 2400))
                self.commands.append(f"G1 X{x:.2f} Y{y:.2f} E{e:.5f} F{feed}")
            self.commands += [f"G1 E{e - 0.2:.5f} F60", f"G0 Z{z + 0.25:.2f} F300"]
            self.ends.append((len(self.commands), {"X": x, "Y": y, "Z": z + 0.25, "E": e - 0.2}))

    def _place(self, reach: int) -> tuple[float, float]:
        """A place within ``reach`` twentieths of a mm, of whole steps."""
        x, y = (50 + 0.05 * int(one) for one in self.rng.integers(-reach, reach + 1, 2))
        return x, y

    def text(self) -> str:
        """The file, with its marks."""
        lines = list(self.commands)
        for layer, (after, _) in reversed(list(enumerate(self.ends))):
            lines.insert(after, f";LAYER_END:{layer}")
        return "\n".join([*lines, "M400", ""])

    def mend(self, look: int) -> list[str]:
        """A stroke in the first layer's own hull, and back; the same each time it is asked."""
        if look not in self.mends:
            at = self.ends[look - 1][1]
            z, e = at["Z"], at["E"]
            starts = [one.split() for one in self.commands[10 : 10 + MOVES]]
            (x, y), (to_x, to_y) = (tuple(starts[k][1:3]) for k in self.rng.permutation(MOVES)[:2])
            self.mends[look] = [
                f"G1 Z{z + 0.5:.2f} F300", f"G1 {x} {y} F3000", f"G1 Z{z - 0.1:.2f} F300",
                f"G1 E{e + 0.2:.5f} F60", f"G1 {to_x} {to_y} E{e + 0.25:.5f} F400",
                f"G1 E{e + 0.05:.5f} F60", f"G1 Z{z + 0.5:.2f} F300",
                f"G1 X{at['X']:.2f} Y{at['Y']:.2f} F3000", f"G1 Z{z:.2f} F300", f"G92 E{e:.5f}",
            ]  # fmt: skip
        return self.mends[look]

    def grown(self) -> list[str]:
        """The file's commands with what was inserted."""
        grown, begin = list[str](), 0
        for look, (after, _) in enumerate(self.ends, 1):
            grown += self.commands[begin:after] + self.mends.get(look, [])
            begin = after
        return grown + self.commands[begin:]
