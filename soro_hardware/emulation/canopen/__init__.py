"""Emulated CANopen nodes, their bus and its adapters."""
