"""Exception classes of record bundles: unusable bundle, unusable signing key.

::

    RecordsError                exit 1
    ├── BundleError             what is given is no bundle, or none can be made
    └── KeyTrouble              the lab's key can't be used, or the library for it is missing
"""

from __future__ import annotations

from printctl.errors import PrintctlError


class RecordsError(PrintctlError):
    """Base of what goes wrong with records."""


class BundleError(RecordsError):
    """No bundle, or none that can be made."""


class KeyTrouble(RecordsError):  # noqa: N818 (named after what is wrong)
    """A key that can't be used."""
