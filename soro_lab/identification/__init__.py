"""Fitting the parameters of a robot and its valves to recorded runs, and judging models against them."""

from soro_lab.identification.candidates import residuals_or_none
from soro_lab.identification.fit import Fit, Parameter, fit
from soro_lab.identification.frame import CurvatureErrors, MeasurementFrame, curvature_errors, fit_frame
from soro_lab.identification.records import ForcedRun, ReleaseRun, read_forced, read_release
from soro_lab.identification.runs import forced_curvature, release_bend
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
    "ReleaseRun",
    "Step",
    "StepLimits",
    "curvature_errors",
    "find_steps",
    "fit",
    "fit_flow",
    "fit_frame",
    "fit_regulator",
    "forced_curvature",
    "read_forced",
    "read_pressures",
    "read_release",
    "release_bend",
    "residuals_or_none",
]
