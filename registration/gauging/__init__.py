"""Numbers of the aligned scan: deviation from the model, and every vessel along its length."""

from registration.gauging.deviation import Deviation, deviations, summarise
from registration.gauging.vessels import VesselGauge, gauge_vessels

__all__ = ["Deviation", "VesselGauge", "deviations", "gauge_vessels", "summarise"]
