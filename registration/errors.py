"""Exceptions of registration: scan file, segmentation, alignment, datum, dye video, picture.

::

    RegistrationError           anything a user can mend on the registration side
    ├── ScanFileError           a scan that can't be read, or comes without its units
    ├── SegmentationError       empty, saturated or contrastless volume
    ├── AlignmentError          scan and model don't fit each other
    ├── DatumError              a datum that isn't there, isn't seen, or leaves the part free
    ├── DyeError                a film of dye, or its marks, that can't be used
    └── PictureError            a picture of a printed pattern or a board that can't be used
"""

from __future__ import annotations


class RegistrationError(ValueError):
    """Bad input to registration; the message says what, value, limit, unit and remedy."""


class ScanFileError(RegistrationError):
    """A scan file that can't be read, or comes without its units.

    Attributes
    ----------
    missing : tuple of str
        What a file that can be read doesn't say, as `ScanOverrides` names it.
    """

    def __init__(self, message: str, missing: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.missing = missing


class SegmentationError(RegistrationError):
    """A volume in which no lumen or surface can be told from the gel."""


class AlignmentError(RegistrationError):
    """A scan that can't be aligned to the model."""


class DatumError(RegistrationError):
    """A datum that can't be used; the message says which, why, and the remedy."""


class DyeError(RegistrationError):
    """A film of a dye front, or the marks in it, that can't be used."""


class PictureError(RegistrationError):
    """A picture of a pattern or a board that can't be read, or shows something else."""
