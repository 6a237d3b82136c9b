"""Dynamics of a chain of constant-strain links; `SoftArm` is the front."""

from soro_core.model.soft_arm import SoftArm

__all__ = ["SoftArm"]
