"""CANopen (CiA 301) with the profile for proportional valves (CiA 408): codecs, state machine, driver."""
