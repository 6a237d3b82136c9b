"""The command `soro`.

While a program imports, a Ctrl-C is a traceback, or has no effect: an exception in a callback of the import
system is printed and dropped, and the program continues. So this file imports as little as possible before it
sets its own handler, which stays until a command begins.
"""

from __future__ import annotations

import os
import signal
import sys
from itertools import takewhile

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import NoReturn

    import typer


def leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"\nsoro: interrupted before anything was started\n")
    os._exit(128 + number)


# What the help shows, in this order: the commands of each group, and where they are.
_GROUPS = {
    "Core commands": {
        "new": "soro_lab.commands.new:new",
        "run": "soro_ros.commands.run:run",
        "view": "soro_ros.commands.view:view",
        "report": "soro_ros.commands.plot:report",
        "excite": "soro_ros.commands.excite:excite",
        "identify": "soro_lab.commands.identify:identify",
        "doctor": "soro_ros.commands.doctor:doctor",
        "move": "soro_ros.commands.move:move",
    },
    "A running arm": {
        "press": "soro_ros.commands.move:press",
        "grasp": "soro_ros.commands.grasp:grasp",
        "vent": "soro_ros.commands.services:vent",
        "reset": "soro_ros.commands.services:reset",
        "enable": "soro_ros.commands.services:enable",
        "fault": "soro_ros.commands.services:fault",
        "log": "soro_ros.commands.log:log",
    },
    "Recorded runs": {
        "plot": "soro_ros.commands.plot:plot",
        "play": "soro_ros.commands.play:play",
        "replay": "soro_ros.commands.replay:replay",
        "bag": "soro_ros.commands.bag:app",
    },
    "Scenes and models of arms": {
        "scenes": "soro_lab.commands.scenes:scenes",
        "gains": "soro_lab.commands.gains:gains",
        "reach": "soro_lab.commands.reach:reach",
        "place-sensors": "soro_lab.commands.place_sensors:place_sensors",
        "trade": "soro_lab.commands.trade:trade",
        "study": "soro_ros.study.command:study",
    },
    "Valves and regulators": {
        "emulate": "soro_hardware.commands.emulate:emulate",
        "board": "soro_hardware.commands.board:board",
        "hil": "soro_ros.commands.hil:app",
        "fit": "soro_lab.commands.fit:app",
    },
    "Design of soft parts": {
        "identify-fem": "soro_design.commands.identify_fem:identify_fem",
        "design": "soro_design.commands.design:app",
        "fem": "soro_design.commands.fem:app",
    },
}
_OF_SEVERAL = {
    "bag": "Look at recordings, repair and convert them.",
    "hil": "Hardware in the loop: first pressurisation, latency.",
    "fit": "Fit models to recordings of your own hardware.",
    "design": "Find the shape of soft parts, check it, export it.",
    "fem": "Compute parts by finite elements.",
}


def wanted(words: list[str]) -> set[str] | None:
    """Return the commands to import for the words of a command line, None for all."""
    completing = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS")
    if "_SORO_COMPLETE" in os.environ and completing is not None:
        words = completing.split()[1:]
        words = words if len(words) > 1 or completing[-1:].isspace() else []
        options = []
    else:
        options = list(takewhile(lambda word: word.startswith("-"), words))  # "--" may be one
        if "--help" in options or not words:
            return None
    return set(words[len(options) :][:1])


def application(begin: Callable[[], None] = lambda: None, needed: set[str] | None = None) -> typer.Typer:
    """Return the command; import the commands that are needed, None for all, which takes half a second.

    `begin` is called before one begins.
    """
    from importlib import import_module

    import typer

    app = typer.Typer(
        help="Run, record and replay pneumatic soft arms: real ones, emulated ones, simulated ones. A value "
        "may have its unit: 40kPa, 10g, 2mm, 20ms; a number alone is in SI units.",
        no_args_is_help=True,
        # Without it, docstrings keep their line breaks, and typer reads units in brackets as styles.
        rich_markup_mode="markdown",
        pretty_exceptions_enable=False,
    )
    for group, commands in _GROUPS.items():
        for name, place in commands.items():
            if needed is not None and name not in needed:
                app.command(name)(lambda: None)
                continue
            module_name, _, attribute = place.partition(":")
            module = import_module(module_name)
            command = getattr(module, attribute)
            if name in _OF_SEVERAL:
                app.add_typer(command, name=name, help=_OF_SEVERAL[name], rich_help_panel=group)
            else:
                settings = getattr(module, "CONTEXT", None)
                app.command(name, context_settings=settings, rich_help_panel=group)(command)

    def print_version(is_asked: bool) -> None:
        if is_asked:
            from soro_core.jobs.versions import soro_version

            typer.echo(f"soro {soro_version()}")
            raise typer.Exit

    option = typer.Option(
        False, "--version", help="Print the version.", callback=print_version, is_eager=True
    )

    @app.callback()
    def start(version: bool = option) -> None:
        begin()

    return app


def main() -> NoReturn:
    """Entry point: exit status 0 on success, 1 on failure, 2 on wrong use, configuration or installation."""
    previous = signal.signal(signal.SIGINT, leave)
    # As the nodes and jobs: matrices here are so small that a second thread waits for work and takes a core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from soro_core.errors import BagError, ConfigError, SoroError
    from soro_core.extras import named_packages

    def begin() -> None:
        signal.signal(signal.SIGINT, previous)

    try:
        with named_packages():
            application(begin, wanted(sys.argv[1:]))()
    except ConfigError as error:
        print(f"soro: {error}", file=sys.stderr)
        sys.exit(2)
    except SoroError as error:
        print(f"soro: {error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, BagError) and error.code != "disk" else 1)
    except OSError as error:  # a full disk, a file of another user
        # An error of a write, unlike one of an open, does not have the name of the file.
        what = (error.filename, error.strerror or str(error))
        print("soro:", ": ".join(str(part) for part in what if part), file=sys.stderr)
        sys.exit(1)
    finally:
        begin()
    sys.exit(0)


if __name__ == "__main__":
    main()
