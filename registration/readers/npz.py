"""NumPy archives: an array ``volume`` and, as scalars, what else is known of the scan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.readers.metadata import NAMES

MAGIC = (b"PK\x03\x04",)


def read_npz(path: Path) -> tuple[NDArray[np.generic], dict[str, Any]]:
    """Volume and the metadata in an ``.npz`` archive.

    Raises
    ------
    ScanFileError
        When the archive is broken or has no ``volume``.
    """
    try:
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as archive:
            if "volume" not in archive.files:
                raise ScanFileError(
                    f"{path}: has no array 'volume' (it has: {', '.join(archive.files)})"
                )
            found = {name: archive[name].tolist() for name in NAMES if name in archive.files}
            return archive["volume"], found
    except ScanFileError:
        raise
    except Exception as exc:
        # zipfile, zlib and NumPy each raise their own on broken bytes.
        raise ScanFileError(f"{path}: broken archive ({exc}); write it again") from exc
