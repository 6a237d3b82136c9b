"""The command `soro`.

While a program imports, a Ctrl-C is a traceback, or has no effect: an exception in a callback of the import
system is printed and dropped, and the program continues. So this file imports as little as possible before it
sets its own handler, which stays until a command begins.
"""

from __future__ import annotations

import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import NoReturn

    import typer


def leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"\nsoro: interrupted before anything was started\n")
    os._exit(128 + number)


def application(begin: Callable[[], None] = lambda: None) -> typer.Typer:
    """Import every command, which takes half a second or more; `begin` is called before one begins."""
    import typer

    from soro_design.commands import design, fem
    from soro_design.commands.identify_fem import identify_fem
    from soro_hardware.commands.board import board
    from soro_hardware.commands.emulate import emulate
    from soro_lab.commands import fit
    from soro_lab.commands.gains import gains
    from soro_lab.commands.identify import identify
    from soro_lab.commands.new import new
    from soro_lab.commands.place_sensors import place_sensors
    from soro_lab.commands.reach import reach
    from soro_lab.commands.scenes import scenes
    from soro_lab.commands.trade import trade
    from soro_ros.commands import bag, hil, services
    from soro_ros.commands.doctor import doctor
    from soro_ros.commands.excite import excite
    from soro_ros.commands.film import film
    from soro_ros.commands.log import log
    from soro_ros.commands.move import CONTEXT, move
    from soro_ros.commands.play import play
    from soro_ros.commands.plot import plot, report
    from soro_ros.commands.replay import replay
    from soro_ros.commands.run import run
    from soro_ros.commands.view import view
    from soro_ros.study.command import study

    app = typer.Typer(
        help="Run, record and replay pneumatic soft arms: real ones, emulated ones, simulated ones.",
        no_args_is_help=True,
        add_completion=False,
        # Without it, docstrings keep their line breaks, and typer reads units in brackets as styles.
        rich_markup_mode="markdown",
        pretty_exceptions_enable=False,
    )
    app.command()(run)
    app.command()(scenes)
    app.command()(excite)
    app.command()(play)
    app.command()(replay)
    app.command()(film)
    app.command()(plot)
    app.command()(report)
    app.command()(view)
    app.command()(emulate)
    app.command()(doctor)
    app.command()(trade)
    app.command()(study)
    app.command()(board)
    app.command()(reach)
    app.command("place-sensors")(place_sensors)
    app.command()(gains)
    app.command()(identify)
    app.command("identify-fem")(identify_fem)
    app.command()(new)
    app.command(context_settings=CONTEXT)(move)
    for service in (services.vent, services.reset, services.enable, services.fault):
        app.command()(service)
    app.command()(log)
    app.add_typer(fem.app, name="fem", help="Compute parts by finite elements.")
    app.add_typer(fit.app, name="fit", help="Fit models to recordings of your own hardware.")
    app.add_typer(design.app, name="design", help="Find the shape of soft parts, check it, export it.")
    app.add_typer(bag.app, name="bag", help="Look at and repair recordings.")
    app.add_typer(hil.app, name="hil", help="Hardware in the loop: first pressurisation, latency.")

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
    from soro_core.errors import ConfigError, SoroError
    from soro_core.extras import named_packages

    def begin() -> None:
        signal.signal(signal.SIGINT, previous)

    try:
        with named_packages():
            application(begin)()
    except ConfigError as error:
        print(f"soro: {error}", file=sys.stderr)
        sys.exit(2)
    except SoroError as error:
        print(f"soro: {error}", file=sys.stderr)
        sys.exit(1)
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
