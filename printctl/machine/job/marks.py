"""Find comments in a G-code file that mark places to pause: layer or pass ends, reload points.

Ours (`design.toolpath.gcode.marks`): ``;LAYER_END:n``, ``;PASS_END:n``, ``;PART_END:n`` and
``;RELOAD``. Slicers say where a layer begins, which ends the one before: ``;LAYER:n`` (Cura),
``;LAYER_CHANGE`` (PrusaSlicer, OrcaSlicer), ``; CHANGE_LAYER`` (Bambu Studio), ``; layer n,``
(Simplify3D).
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, TypeAlias

Position: TypeAlias = tuple[int, int]
"""Command lines before an insert, in the grown job, and how many it has."""
_OURS: Final = re.compile(rb";(LAYER_END|PASS_END|PART_END|RELOAD)(?::(-?\d+))?\s*$")
_SLICERS: Final = re.compile(rb";(?:LAYER:(-?\d+)|LAYER_CHANGE|\s*CHANGE_LAYER)\s*$|; layer (\d+),")


class MarkKind(StrEnum):
    """What has ended at a mark."""

    LAYER = "layer"
    VESSEL = "vessel"
    PART = "part"
    RELOAD = "reload"


_KIND: Final = {
    b"LAYER_END": MarkKind.LAYER,
    b"PASS_END": MarkKind.VESSEL,
    b"PART_END": MarkKind.PART,
    b"RELOAD": MarkKind.RELOAD,
}
_WORDS: Final = {
    MarkKind.LAYER: "end of layer",
    MarkKind.VESSEL: "end of vessel",
    MarkKind.PART: "end of a part of vessel",
    MarkKind.RELOAD: "reload point",
}


@dataclass(frozen=True)
class Mark:
    """A place between two lines of a job, with ``index`` command lines before it.

    ``number`` is of the layer or vessel that ended (of a part: that is written so far), from 0; -1
    where the file doesn't say.
    """

    index: int
    kind: MarkKind
    number: int = -1

    def __str__(self) -> str:
        # People and slicers' views count layers from 1; vessels have a network's numbers.
        number = self.number + (self.kind is MarkKind.LAYER)
        return f"{_WORDS[self.kind]} {number}" if self.number >= 0 else _WORDS[self.kind]


def read_marks(comments: Iterable[tuple[int, bytes]]) -> list[Mark]:
    """Return the marks of a file's comments, each with the count of commands before it."""
    marks, layers_begun = list[Mark](), 0
    for index, text in comments:
        ours = _OURS.match(text)
        begun = None if ours else _SLICERS.match(text)
        if ours:
            marks.append(Mark(index, _KIND[ours[1]], int(ours[2] or -1)))
        elif begun:
            if layers_begun:  # the first layer's beginning is no end
                # The layer that ends there, from 0: Cura counts from 0, Simplify3D from 1.
                ended = int(begun[1]) - 1 if begun[1] else int(begun[2]) - 2 if begun[2] else -1
                marks.append(Mark(index, MarkKind.LAYER, max(ended, -1)))
            layers_begun += 1
    return marks


def behind(index: int, after: int, count: int) -> int:
    """Return a place between lines of a job as it is once ``count`` lines follow its ``after``."""
    return index + count if index > after else index


class Marks:
    """The marks of a job in the file's order, to be searched while it is printed."""

    def __init__(self, found: list[Mark]) -> None:
        self.all = tuple(found)
        self._by_kind = {kind: [mark for mark in found if mark.kind is kind] for kind in MarkKind}
        self._index = {kind: [mark.index for mark in of] for kind, of in self._by_kind.items()}

    def __len__(self) -> int:
        return len(self.all)

    def shifted(self, after: int, count: int) -> Marks:
        """Return them with ``count`` lines put in behind the first ``after``: those there stay."""
        return Marks([replace(one, index=behind(one.index, after, count)) for one in self.all])

    def of(self, kind: MarkKind) -> list[Mark]:
        """Return all of one kind."""
        return self._by_kind[kind]

    def next(self, kind: MarkKind, index: int) -> Mark | None:
        """Return the first of a kind at or after ``index``."""
        place = bisect_left(self._index[kind], index)
        return next(iter(self._by_kind[kind][place : place + 1]), None)

    def last(self, kind: MarkKind, index: int) -> Mark | None:
        """Return the last of a kind at or before ``index``."""
        place = bisect_right(self._index[kind], index)
        return self._by_kind[kind][place - 1] if place else None

    def here(self, index: int) -> list[Mark]:
        """Return all kinds' marks at ``index``."""
        each = (self.next(kind, index) for kind in MarkKind)
        return [mark for mark in each if mark is not None and mark.index == index]
