"""Regulators on serial text lines: SMC ITV (RS-232C, a port a valve) and Alicat (multi-drop)."""
