"""Fitting the parameters of a robot and its valves to recorded runs, and judging models against them."""

from soro_lab.identification.candidates import residuals_or_none
from soro_lab.identification.fit import Fit, Parameter, fit
from soro_lab.identification.frame import CurvatureErrors, MeasurementFrame, curvature_errors
from soro_lab.identification.records import ForcedRun, read_forced
from soro_lab.identification.steps import PressureRecord, Step, StepLimits, find_steps, read_pressures
from soro_lab.identification.valves import FlowModel, fit_flow, fit_regulator

__all__ = [
    "CurvatureErrors",
    "Fit",
    "FlowModel",
    "ForcedRun",
    "MeasurementFrame",
    "Parameter",
    "PressureRecord",
    "Step",
    "StepLimits",
    "curvature_errors",
    "find_steps",
    "fit",
    "fit_flow",
    "fit_regulator",
    "read_forced",
    "read_pressures",
    "residuals_or_none",
]
