"""Gauge study (GRR) of registrations: variance by repeat, operator and part, with results as text.

Goes in: registrations by operator, part and repeat. Comes out: variance components. Begin with
`study.py`.
"""

from registration.comparison.gauge.findings import (
    claim_sentence,
    gauge_csv,
    gauge_dict,
    gauge_notes,
    gauge_sentences,
)
from registration.comparison.gauge.study import GaugeQuantity, GaugeStudy, gauge_study

__all__ = [
    "GaugeQuantity",
    "GaugeStudy",
    "claim_sentence",
    "gauge_csv",
    "gauge_dict",
    "gauge_notes",
    "gauge_sentences",
    "gauge_study",
]
