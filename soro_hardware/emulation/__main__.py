"""`python -m soro_hardware.emulation PLATFORM`: the emulator without the command line tool."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from soro_core.errors import ConfigError, SoroError
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.emulation.process import serve
from soro_hardware.families import load_platform


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and serve; return 0 after a signal, 2 for wrong use, 1 for another error."""
    parser = argparse.ArgumentParser(prog="python -m soro_hardware.emulation", description=__doc__)
    parser.add_argument("platform", help="name of a shipped platform, or path of a platform file")
    parser.add_argument(
        "--lockstep", action="store_true", help="advance the time by the host's cycles, not by the clock"
    )
    parser.add_argument("--cycle-hz", type=float, help="rate of the cycles, if it is not the platform's")
    parser.add_argument("--device-link", type=Path, help="symbolic link to make for the host")
    parser.add_argument("--plant-link", type=Path, help="Unix socket for a twin")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sensor noise")
    parser.add_argument("--control", type=Path, help="Unix socket for faults")
    parser.add_argument("--fault", action="append", default=[], help="a fault as YAML, see `soro emulate`")
    given = parser.parse_args(arguments)

    def announce(path: str) -> None:
        sys.stdout.write(f"ready: {path}\n")
        sys.stdout.flush()

    try:
        platform = load_platform(given.platform)
        serve(
            platform if given.cycle_hz is None else platform.at_rate(given.cycle_hz),
            clock=time.monotonic_ns,
            announce=announce,
            lockstep=given.lockstep,
            device_link=given.device_link,
            plant_link=given.plant_link,
            seed=given.seed,
            control=given.control,
            faults=[read_injection(text, "--fault") for text in given.fault],
        )
    except SoroError as error:
        sys.stderr.write(f"{error}\n")
        return 2 if isinstance(error, ConfigError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
