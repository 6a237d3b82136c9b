"""Check of a board: its identity and the state of its ports; sends no commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from soro_hardware.board import frames, texts
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.messages import Cause
from soro_hardware.board.session import BoardSession
from soro_hardware.finding import Finding, run_check


def examine(platform: BoardPlatform, session: BoardSession, clock: Callable[[], float]) -> Iterator[Finding]:
    """Send HELLO to the board, read its answer, and disconnect; yields findings.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, range and times.
    session : BoardSession
        Frames of the driver.
    clock : callable
        Returns a monotonic time [s].
    """
    advice = "start `soro board` on the Pi; check address, port and cable"
    return run_check("board", advice, _greet(platform, session, clock), session.link.close)


def _greet(platform: BoardPlatform, session: BoardSession, clock: Callable[[], float]) -> Iterator[Finding]:
    session.link.open()
    session.greet()
    deadline = clock() + platform.host.start_timeout_s
    while (session.welcome is None or session.state is None) and session.refusal is None:
        if (left := deadline - clock()) <= 0:
            advice = (
                f"install the same version of soro on the Pi (frames {frames.VERSION}); "
                "use family veab_tcp for the published server, or another port"
            )
            yield Finding("board", "fail", "the server does not send frames of soro board", advice)
            return
        session.receive(left)
    if session.refusal is not None or session.welcome is None or session.state is None:
        code = 0 if session.refusal is None else session.refusal[0]
        yield Finding("board", "fail", f"it {texts.refusal(code)}", texts.advice(code))
        return
    welcome, state = session.welcome, session.state
    known = f"boot {welcome.boot:08x}, {len(welcome.limits_pa)} ports, watchdog {welcome.watchdog_ms} ms"
    yield Finding("board", "ok", known)
    low, high = round(platform.range.minimum_pa), round(platform.range.maximum_pa)
    other = [valve.port for valve in platform.valves if welcome.limits_pa[valve.port] != (low, high)]
    if other:
        lowest, highest = welcome.limits_pa[other[0]]
        found = f"port {other[0]}: {lowest / 1e3:g} to {highest / 1e3:g} kPa on the board"
        yield Finding(
            "range on the board", "fail", found, "give the Pi the same platform file and restart it"
        )
    if state.cause is Cause.STOP_CONTACT:
        advice = "release the emergency stop; if it is, look for a broken wire of its contact"
        yield Finding("stop contact", "warn", f"the board {texts.CAUSES[state.cause][1]}", advice)
    if complaints := texts.complaints(state):
        advice = "check the chips' power, address and bus: `soro board CONFIG --check` on the Pi"
        yield Finding("chips", "warn", complaints.strip(" ()"), advice)
