"""Fitting the parameters of a robot to recorded runs, and judging a robot against them."""

from soro_core.identification.fit import Fit, Parameter, fit
from soro_core.identification.frame import CurvatureErrors, Frame, curvature_errors, fit_frame
from soro_core.identification.records import ForcedRun, ReleaseRun, read_forced, read_release
from soro_core.identification.runs import forced_curvature, release_bend

__all__ = [
    "CurvatureErrors",
    "Fit",
    "ForcedRun",
    "Frame",
    "Parameter",
    "ReleaseRun",
    "curvature_errors",
    "fit",
    "fit_frame",
    "forced_curvature",
    "read_forced",
    "read_release",
    "release_bend",
]
