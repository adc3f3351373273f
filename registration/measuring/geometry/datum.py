"""Parse datum names (face +x, axis 3, outlet 2, ports) from a recipe or the command line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from registration.errors import DatumError

Kind = Literal["face", "axis", "inlet", "outlet", "ports"]
BEST_FIT = "best fit"
MOST = 3
_FACE = re.compile(r"^face\s*([+\N{MINUS SIGN}-])\s*([xyz])$")
_VESSEL = re.compile(r"^(axis|inlet|outlet)\s+(\d{1,6})$")


@dataclass(frozen=True)
class Datum:
    """One datum feature.

    Attributes
    ----------
    kind : str
        ``face``: a planar outer face; ``axis``: of a straight vessel; ``inlet``, ``outlet``: the
        mouth at a vessel's first or last node; ``ports``: all mouths together.
    where : str
        Of a face: the way it looks, like ``-z``.
    vessel : int
        Of an axis or mouth.
    """

    kind: Kind
    where: str = ""
    vessel: int = -1

    def __str__(self) -> str:
        if self.kind == "ports":
            return "ports"
        sign = self.where.replace("-", "\N{MINUS SIGN}")
        return f"face {sign}" if self.kind == "face" else f"{self.kind} {self.vessel}"


def read_datum(text: str) -> Datum:
    """Return the datum that a text names.

    Raises
    ------
    DatumError
    """
    name = " ".join(text.lower().split())
    if name == "ports":
        return Datum("ports")
    if match := _FACE.match(name):
        return Datum("face", ("+" if match[1] == "+" else "-") + match[2])
    if match := _VESSEL.match(name):
        kinds: dict[str, Kind] = {"axis": "axis", "inlet": "inlet", "outlet": "outlet"}
        return Datum(kinds[match[1]], vessel=int(match[2]))
    raise DatumError(
        f"datum {text!r} isn't known; give a face by the way it looks (face -z), a straight "
        "vessel's axis (axis 3), a mouth by its vessel (inlet 0, outlet 3), or ports"
    )


def read_datums(texts: Sequence[str]) -> tuple[Datum, ...]:
    """Return primary, secondary and tertiary datum; none for the best fit.

    Raises
    ------
    DatumError
        For one that isn't known, given twice, or too many.
    """
    given = [text for text in texts if text.strip()]
    if [text.strip().lower() for text in given] == [BEST_FIT]:
        return ()
    datums = tuple(map(read_datum, given))
    if len(datums) > MOST:
        raise DatumError(
            f"{len(datums)} datums are given, of at most {MOST}; name primary, secondary, tertiary"
        )
    for one in datums:
        if datums.count(one) > 1:
            raise DatumError(f"datum {one} is given twice; name another feature")
    return datums
