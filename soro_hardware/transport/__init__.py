"""Transports: CAN frames over adapters and servers, byte streams over TCP."""
