"""Hardware in the loop: procedures on regulators, all of them behind the limiter of `soro_core.safety`."""
