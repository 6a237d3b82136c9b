"""What the board decides, as functions of (state, frame or reading, now): no socket, no chip, no clock.

The rules that keep the arm safe:

- Pressure is asked for only by a SET whose CRC, length, sequence and range are right, from a host that has
  said HELLO, while nothing is latched.
- The first good SET arms the watchdog, every further one feeds it. Silence for `watchdog_ns`, a connection
  that ends without BYE, a chip that fails or has been without power: every port goes to 0 Pa, latched.
- RESET, and nothing else, opens the latch, at 0 Pa, after the self-test has passed again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from soro_core.hardware.board import messages
from soro_core.hardware.board.frames import Frame, Kind
from soro_core.hardware.board.messages import Cause, PortFlag, Refusal


@dataclass(frozen=True)
class Rules:
    """Parameters of the decisions; range in Pa gauge for every port."""

    ports: int
    minimum_pa: int
    maximum_pa: int
    watchdog_ns: int
    tolerated_errors: int


@dataclass(frozen=True)
class BoardState:
    """State of the board.

    Attributes
    ----------
    setpoint_pa : tuple of int
        What the DACs are to be given.
    cause : Cause
        Why it is latched at 0 Pa, or NONE.
    greeted : bool
        Whether the host that is connected has said HELLO.
    sequence : int
        That of the newest SET, 0 before the first.
    fed_ns : int or None
        When the watchdog was last fed; None while it is not armed.
    failed : tuple of int
        For each port, cycles in a row in which a chip did not answer.
    refused : int
        Frames that were understood and not obeyed.
    """

    setpoint_pa: tuple[int, ...]
    cause: Cause = Cause.NONE
    greeted: bool = False
    sequence: int = 0
    fed_ns: int | None = None
    failed: tuple[int, ...] = ()
    refused: int = 0


def initial_state(rules: Rules) -> BoardState:
    """Everything at 0 Pa, no host."""
    return BoardState(setpoint_pa=(0,) * rules.ports, failed=(0,) * rules.ports)


def receive(
    rules: Rules, state: BoardState, frame: Frame, now_ns: int
) -> tuple[BoardState, Refusal | None, int]:
    """Take a frame of the host: new state, why it was refused (or None) and at which port.

    HELLO, RESET and SET are to be answered; see `soro_core.hardware.board.frames`.
    """
    if frame.kind is Kind.HELLO:
        if messages.unpack_hello(frame.payload) != rules.ports:
            return _refuse(state, Refusal.PORTS)
        return replace(vent(state), greeted=True, sequence=0, fed_ns=None), None, 0
    if not state.greeted:
        return _refuse(state, Refusal.NO_HELLO)
    if frame.kind is Kind.SET:
        return _set(rules, state, frame, now_ns)
    if frame.kind is Kind.RESET:
        quiet = replace(vent(state), fed_ns=None, failed=(0,) * rules.ports)
        return replace(quiet, sequence=frame.sequence), None, 0
    if frame.kind is Kind.BYE:
        return replace(vent(state), greeted=False, fed_ns=None), None, 0
    return _refuse(state, Refusal.NO_HELLO)


def tested(state: BoardState, passed: bool) -> BoardState:
    """Take the result of a self-test, which opens the latch or closes it."""
    return replace(state, cause=Cause.NONE if passed else Cause.SELF_TEST)


def watch(rules: Rules, state: BoardState, now_ns: int) -> BoardState:
    """Vent when the host has been silent for too long."""
    if state.fed_ns is not None and now_ns - state.fed_ns >= rules.watchdog_ns:
        return latch(state, Cause.WATCHDOG)
    return state


def host_gone(state: BoardState) -> BoardState:
    """Vent when the connection ends; it is latched where pressure may have been asked for."""
    gone = replace(state, greeted=False)
    return latch(gone, Cause.HOST_GONE) if state.fed_ns is not None else vent(gone)


def judge(rules: Rules, state: BoardState, flags: Sequence[PortFlag]) -> BoardState:
    """Look at what a cycle has said of the chips."""
    bad = PortFlag.DAC_ERROR | PortFlag.ADC_ERROR
    failed = tuple(n + 1 if flag & bad else 0 for n, flag in zip(state.failed, flags, strict=True))
    state = replace(state, failed=failed)
    if any(flag & PortFlag.CHIP_RESET for flag in flags):
        return latch(state, Cause.CHIP_RESET)
    if max(failed) >= rules.tolerated_errors:
        return latch(state, Cause.DEVICE_ERROR)
    return state


def latch(state: BoardState, cause: Cause) -> BoardState:
    """Vent and stay so; the first cause stays."""
    return replace(vent(state), fed_ns=None, cause=state.cause or cause)


def vent(state: BoardState) -> BoardState:
    """Ask every port for 0 Pa."""
    return replace(state, setpoint_pa=(0,) * len(state.setpoint_pa))


def _set(
    rules: Rules, state: BoardState, frame: Frame, now_ns: int
) -> tuple[BoardState, Refusal | None, int]:
    # Sequence numbers wrap; half the range counts as newer.
    if not 0 < (frame.sequence - state.sequence) & 0xFFFFFFFF < 0x80000000:
        return _refuse(state, Refusal.OLD)
    asked = messages.unpack_set(frame.payload)
    for port, value in enumerate(asked):
        if not rules.minimum_pa <= value <= rules.maximum_pa:
            return _refuse(replace(state, sequence=frame.sequence), Refusal.RANGE, port)
    if state.cause:
        return replace(state, sequence=frame.sequence), None, 0  # the answer names the cause
    return replace(state, sequence=frame.sequence, setpoint_pa=asked, fed_ns=now_ns), None, 0


def _refuse(state: BoardState, why: Refusal, port: int = 0) -> tuple[BoardState, Refusal, int]:
    return replace(state, refused=state.refused + 1), why, port


def refusal(frame: Frame, why: Refusal, port: int) -> Frame:
    """Answer to a frame that is not obeyed."""
    return Frame(Kind.REFUSED, frame.sequence, messages.pack_refused(why, port))
