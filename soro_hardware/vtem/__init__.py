"""Festo VTEM motion terminal, motion app 03 (proportional pressure), over Modbus TCP."""
