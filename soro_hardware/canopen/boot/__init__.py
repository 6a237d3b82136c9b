"""The start-up of CANopen nodes over SDO."""
