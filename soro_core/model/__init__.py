"""Dynamics of an arm as a chain of Cosserat rods (PCC, PCS, GVS: docs/model.md); `SoftArm` is the front."""

from soro_core.model.soft_arm import SoftArm

__all__ = ["SoftArm"]
