"""Parse names of wells: A1, B1..B3 along a row, A1..C4 for a block."""

from __future__ import annotations

import re
from collections.abc import Sequence
from string import ascii_uppercase
from typing import Final

from firmware_profiles import Plate
from printctl.errors import RecipeError

_NAME: Final = re.compile(r"([A-Za-z])0*([1-9]\d?)")


def expand(words: Sequence[str], plate: Plate, key: str) -> list[str]:
    """Wells that some words name, in their order.

    Parameters
    ----------
    words : sequence of str
    plate : Plate
    key : str
        Of the recipe, for messages.

    Raises
    ------
    RecipeError
        For what is no name, isn't on the plate or is named twice.
    """
    wells = [well for word in words for well in _of_word(word, plate, key)]
    twice = next((well for well in wells if wells.count(well) > 1), None)
    if twice:
        raise RecipeError(f"{key} names {twice} twice; a well holds one part, so name it once")
    return wells


def _of_word(word: str, plate: Plate, key: str) -> list[str]:
    first, _, last = word.partition("..")
    row, column = _place(first, plate, key)
    if not last:
        return [_name(row, column)]
    last_row, last_column = _place(last, plate, key)
    if last_row < row or last_column < column:
        raise RecipeError(
            f"{key}: {word} runs backwards; name the well behind on the left first, as in "
            f"{_name(min(row, last_row), min(column, last_column))}.."
            f"{_name(max(row, last_row), max(column, last_column))}"
        )
    return [_name(r, c) for r in range(row, last_row + 1) for c in range(column, last_column + 1)]


def _place(name: str, plate: Plate, key: str) -> tuple[int, int]:
    """Row and column from 0."""
    match = _NAME.fullmatch(name.strip())
    if match is None:
        raise RecipeError(
            f"{key}: {name!r} is no well; name wells like A1, or blocks of them like B1..B3"
        )
    row, column = ascii_uppercase.index(match[1].upper()), int(match[2]) - 1
    if row >= plate.rows or column >= plate.columns:
        raise RecipeError(
            f"{key}: well {name} isn't on {plate.name}, which has rows A to "
            f"{ascii_uppercase[plate.rows - 1]} and columns 1 to {plate.columns}"
        )
    return row, column


def _name(row: int, column: int) -> str:
    return f"{ascii_uppercase[row]}{column + 1}"
