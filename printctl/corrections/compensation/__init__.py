"""Read, check and write the compensation file: geometry corrections derived from earlier prints.

Goes in: a YAML file. Comes out: checked corrections, and the same back. Begin with `schema.py`.
"""

from printctl.corrections.compensation.files import (
    check_suffix,
    corrections_of_file,
    load_compensation,
    save_compensation,
)
from printctl.corrections.compensation.schema import (
    CompensationFile,
    DesignPart,
    GainPart,
    NodePart,
    PrintConditions,
    PrintPart,
    RadialPart,
    StretchPart,
    VesselPart,
)
from printctl.corrections.compensation.summary import changes_line

__all__ = [
    "CompensationFile",
    "DesignPart",
    "GainPart",
    "NodePart",
    "PrintConditions",
    "PrintPart",
    "RadialPart",
    "StretchPart",
    "VesselPart",
    "changes_line",
    "check_suffix",
    "corrections_of_file",
    "load_compensation",
    "save_compensation",
]
