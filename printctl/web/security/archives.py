"""Refuse an archive that unpacks beyond a size limit or a compression ratio.

Bytes are counted as they come out: what the archive says of itself isn't believed.
"""

from __future__ import annotations

from dataclasses import dataclass

from printctl.web.errors import BadRequestError


@dataclass(frozen=True)
class ArchiveLimits:
    """Size limits of an unpacked archive.

    Attributes
    ----------
    bytes : int
        Of all files together.
    ratio : float
        Bytes out for a byte in.
    ratio_from : int
        Bytes out from which the ratio counts.
    """

    bytes: int = 8_000_000_000
    ratio: float = 200.0
    ratio_from: int = 10_000_000


def check_growth(total: int, packed: int, limits: ArchiveLimits) -> None:
    """Refuse an archive that has given ``total`` bytes out of ``packed``, if that is too much.

    Raises
    ------
    BadRequestError
    """
    if total > limits.bytes:
        raise BadRequestError(
            f"the archive unpacks to more than {total / 1e6:.0f} MB; at most "
            f"{limits.bytes / 1e6:g} MB are taken"
        )
    if total > limits.ratio_from and total > limits.ratio * packed:
        raise BadRequestError(
            f"the archive unpacks to more than {limits.ratio:g} times its size; pack it anew "
            "without emptiness, or send the files alone"
        )
