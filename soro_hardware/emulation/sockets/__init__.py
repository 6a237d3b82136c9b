"""Sockets of an emulator: the link to the twin of the arm, and control from outside."""
