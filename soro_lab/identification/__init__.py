"""Fitting the parameters of a robot and its valves to recorded runs, and judging models against them."""

from soro_lab.identification.candidates import residuals_or_none as residuals_or_none
from soro_lab.identification.fit import Fit as Fit
from soro_lab.identification.fit import Parameter as Parameter
from soro_lab.identification.fit import fit as fit
from soro_lab.identification.frame import CurvatureErrors as CurvatureErrors
from soro_lab.identification.frame import MeasurementFrame as MeasurementFrame
from soro_lab.identification.frame import curvature_errors as curvature_errors
from soro_lab.identification.records import ForcedRun as ForcedRun
from soro_lab.identification.records import read_forced as read_forced
from soro_lab.identification.steps import PressureRecord as PressureRecord
from soro_lab.identification.steps import Step as Step
from soro_lab.identification.steps import StepLimits as StepLimits
from soro_lab.identification.steps import find_steps as find_steps
from soro_lab.identification.steps import read_pressures as read_pressures
from soro_lab.identification.valves import FlowModel as FlowModel
from soro_lab.identification.valves import fit_flow as fit_flow
from soro_lab.identification.valves import fit_regulator as fit_regulator
