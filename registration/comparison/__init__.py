"""Compare prints of one design: spread, drift, capability, shared defects, gauge study.

Goes in: several registrations. Comes out: spread, drift, capability, findings. Begin with
`compare.py`.
"""

from registration.comparison.compare import Comparison, compare
from registration.comparison.findings import (
    comparison_csv,
    comparison_dict,
    notes,
    verdict,
)
from registration.comparison.gauge_findings import gauge_csv
from registration.comparison.scans import (
    ComparisonError,
    GaugedScan,
    GaugeStudyError,
    Origin,
    gauged_scan,
)

__all__ = [
    "Comparison",
    "ComparisonError",
    "GaugeStudyError",
    "GaugedScan",
    "Origin",
    "compare",
    "comparison_csv",
    "comparison_dict",
    "gauge_csv",
    "gauged_scan",
    "notes",
    "verdict",
]
