"""The probe before control: each chamber alone to a small pressure, and what its answer says of wiring and base."""
