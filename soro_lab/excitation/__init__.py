"""Excitation of an arm: safe set points from which its parameters can be identified."""

from soro_lab.excitation.config import ExciteConfig as ExciteConfig
from soro_lab.excitation.config import MotionLimits as MotionLimits
