"""Write tables of flow calculations: each a CSV, or all as arrays of one NPZ."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from design.files import atomic_replacement, write_text

NPZ: Final = "flow.npz"


class FlowTables(Protocol):
    """Interface of what takes a calculation's tables.

    Attributes
    ----------
    files : list of Path
        Written so far.
    """

    files: list[Path]

    def put(self, name: str, table: Mapping[str, NDArray[Any]]) -> None:
        """Take a table of columns of equal length, by the name of its CSV file.

        Raises
        ------
        OSError
            When the file can't be written.
        """
        ...


class CsvTables:
    """Each table a CSV file in a folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.files: list[Path] = []

    def put(self, name: str, table: Mapping[str, NDArray[Any]]) -> None:
        """Write the table under its name."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_columns(self._folder / name, table)
        self.files.append(self._folder / name)


class NpzTables:
    """All tables in one NPZ file, each column an array named ``table/column``.

    ``flow_pulsatile.csv`` becomes ``flow_pulsatile/vessel`` and so on; text is text of fixed
    width. The file holds all tables so far after each `put`.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._arrays: dict[str, NDArray[Any]] = {}
        self.files = [path]

    def put(self, name: str, table: Mapping[str, NDArray[Any]]) -> None:
        """Add the table and write the file."""
        stem = Path(name).stem
        self._arrays |= {f"{stem}/{column}": np.asarray(table[column]) for column in table}
        with atomic_replacement(self.files[0]) as draft:
            np.savez(draft, **self._arrays)  # type: ignore[arg-type]


def write_columns(path: Path, table: Mapping[str, Any]) -> None:
    """Write columns of equal length as CSV at full precision."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    write_text(path, out.getvalue())
