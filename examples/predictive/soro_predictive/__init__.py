"""The law `predictive`: set points that are best over the next third of a second."""

from soro_predictive.law import Predictive, PredictiveOptions

__all__ = ["Predictive", "PredictiveOptions"]
