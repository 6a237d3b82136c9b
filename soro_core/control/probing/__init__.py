"""The probe before control: each chamber alone to a small pressure, and what the answers say."""
