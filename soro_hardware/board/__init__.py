"""`soro board`: a server for boards of DACs and ADCs on a Raspberry Pi, and its driver."""
