"""What the doctor asks a board: who it is, and what it says of its ports. Nothing is reset or commanded."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from soro_core.errors import HardwareError
from soro_core.hardware.board import texts
from soro_core.hardware.board.config import BoardPlatform
from soro_core.hardware.board.session import Session
from soro_core.hardware.finding import Finding


def look(platform: BoardPlatform, session: Session, clock: Callable[[], float]) -> Iterator[Finding]:
    """Greet the board as a host does, hear what it answers, and leave."""
    try:
        session.link.open()
        yield from _greet(platform, session, clock)
    except HardwareError as error:
        advice = "start `soro board` on the Pi; see that address and port are its, and the cable is in"
        yield Finding("board", "fail", str(error), advice)
    finally:
        session.link.close()


def _greet(platform: BoardPlatform, session: Session, clock: Callable[[], float]) -> Iterator[Finding]:
    session.greet()
    deadline = clock() + platform.host.start_timeout_s
    while (session.welcome is None or session.state is None) and session.refused is None:
        if (left := deadline - clock()) <= 0:
            advice = "something else listens there: veab_tcp for the published server, or another port"
            yield Finding("board", "fail", "connected, but it does not speak soro board's frames", advice)
            return
        session.receive(left)
    if session.refused is not None or session.welcome is None or session.state is None:
        code = 0 if session.refused is None else session.refused[0]
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
    if complaints := texts.complaints(state):
        advice = "check the chips' power, address and bus: `soro board CONFIG --check` on the Pi"
        yield Finding("chips", "warn", complaints.strip(" ()"), advice)
