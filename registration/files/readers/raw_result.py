"""Record of a volume and the metadata in its file, as a reader returns them, unchecked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.files.readers.space import FileSpace

Array = NDArray[np.generic]


@dataclass(frozen=True)
class FileVolume:
    """A volume as it lies in its file, and what the file says of it.

    Attributes
    ----------
    volume : array of three axes, any strides
        A view of the file where that is possible, so that nothing is read twice.
    known : mapping
        What the file says, by the names of `ScanOverrides` (``axes`` included).
    space : FileSpace or None
        How the array's axes run in space; None where the file doesn't say.
    notes : tuple of str
        What the user should know of this reading.
    """

    volume: Array
    known: Mapping[str, Any] = field(default_factory=dict)
    space: FileSpace | None = None
    notes: tuple[str, ...] = ()
