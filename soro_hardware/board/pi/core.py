"""Decisions of the board: pure functions of state, frame or readings, and time.

The rules that keep the arm safe:

- Only a SET with the right CRC, length, sequence and range commands pressure, from a host that has sent
  HELLO, with the number that WELCOME gave to it, while nothing is latched.
- A host without HELLO or with another number is parted with: `parts`.
- The first good SET arms the watchdog, each further one feeds it. The board vents every port and latches
  after `watchdog_ns` without a SET, after the end of a connection without BYE, when a chip fails or has been
  without power, and while the contact of the emergency stop is open.
- Only RESET opens the latch, at 0 Pa, after another successful self-test, with the contact closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from soro_hardware.board import messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Cause, PortFlag, Refusal


@dataclass(frozen=True)
class Rules:
    """Parameters of the decisions: number of ports, range [Pa gauge], watchdog [ns], tolerated errors."""

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
        Set point of each port [Pa gauge].
    cause : Cause
        Cause of the latch, or NONE.
    greeted : bool
        Whether the connected host has sent HELLO.
    number : int
        Number that its frames must have, 0 before the first HELLO.
    sequence : int
        Sequence number of the newest SET, 0 before the first.
    fed_ns : int or None
        Time [ns] of the last SET; None while the watchdog is not armed.
    failed : tuple of int
        For each port, number of consecutive cycles without an answer of a chip.
    refused : int
        Number of refused frames.
    """

    setpoint_pa: tuple[int, ...]
    cause: Cause = Cause.NONE
    greeted: bool = False
    number: int = 0
    sequence: int = 0
    fed_ns: int | None = None
    failed: tuple[int, ...] = ()
    refused: int = 0


def initial_state(rules: Rules) -> BoardState:
    """Return the state at the start: all ports at 0 Pa, no host."""
    return BoardState(setpoint_pa=(0,) * rules.ports, failed=(0,) * rules.ports)


def receive(
    rules: Rules, state: BoardState, frame: BoardFrame, now_ns: int, fresh: int
) -> tuple[BoardState, Refusal | None, int]:
    """Process a frame of the host.

    Parameters
    ----------
    rules : Rules
        Parameters of the decisions.
    state : BoardState
        State before the frame.
    frame : BoardFrame
        Frame of the host; the caller answers HELLO, RESET and SET.
    now_ns : int
        Present time [ns].
    fresh : int
        Number for the host, if this is a good HELLO; nobody can guess it.

    Returns
    -------
    state : BoardState
    refusal : Refusal or None
        Why the frame is refused.
    port : int
        Port of the refusal.
    """
    if frame.kind is FrameType.HELLO:
        if messages.unpack_hello(frame.payload) != rules.ports:
            return _refuse(state, Refusal.PORTS)
        return replace(vent(state), greeted=True, number=fresh, sequence=0, fed_ns=None), None, 0
    if not state.greeted:
        return _refuse(state, Refusal.NO_HELLO)
    if frame.number != state.number:
        return _refuse(state, Refusal.NUMBER)
    if frame.kind is FrameType.SET:
        return _set(rules, state, frame, now_ns)
    if frame.kind is FrameType.RESET:
        quiet = replace(vent(state), fed_ns=None, failed=(0,) * rules.ports)
        return replace(quiet, sequence=frame.sequence), None, 0
    if frame.kind is FrameType.BYE:
        return replace(vent(state), greeted=False, fed_ns=None), None, 0
    return _refuse(state, Refusal.NO_HELLO)


def parts(why: Refusal | None) -> bool:
    """Return whether the connection of a host that is refused for a reason ends."""
    return why in (Refusal.NO_HELLO, Refusal.NUMBER)


def tested(state: BoardState, passed: bool) -> BoardState:
    """Open the latch after a successful self-test, or close it."""
    return replace(state, cause=Cause.NONE if passed else Cause.SELF_TEST)


def watch(rules: Rules, state: BoardState, now_ns: int, is_pressed: bool = False) -> BoardState:
    """Latch when the emergency stop is pressed, or no SET has arrived for the time of the watchdog.

    Parameters
    ----------
    rules : Rules
        Parameters of the decisions.
    state : BoardState
        State before the call.
    now_ns : int
        Present time [ns].
    is_pressed : bool
        Whether the emergency stop is pressed.
    """
    if is_pressed:
        return latch(state, Cause.STOP_CONTACT)
    if state.fed_ns is not None and now_ns - state.fed_ns >= rules.watchdog_ns:
        return latch(state, Cause.WATCHDOG)
    return state


def host_gone(state: BoardState) -> BoardState:
    """Vent at the end of a connection; latch if the watchdog is armed."""
    gone = replace(state, greeted=False)
    return latch(gone, Cause.HOST_GONE) if state.fed_ns is not None else vent(gone)


def judge(rules: Rules, state: BoardState, flags: Sequence[PortFlag]) -> BoardState:
    """Latch when a chip has failed.

    Parameters
    ----------
    rules : Rules
        Parameters of the decisions.
    state : BoardState
        State before the call.
    flags : sequence of PortFlag
        Errors of each port in this cycle.
    """
    bad = PortFlag.DAC_ERROR | PortFlag.ADC_ERROR
    failed = tuple(n + 1 if flag & bad else 0 for n, flag in zip(state.failed, flags, strict=True))
    state = replace(state, failed=failed)
    if any(flag & PortFlag.CHIP_RESET for flag in flags):
        return latch(state, Cause.CHIP_RESET)
    if max(failed) >= rules.tolerated_errors:
        return latch(state, Cause.DEVICE_ERROR)
    return state


def latch(state: BoardState, cause: Cause) -> BoardState:
    """Vent and latch; the first cause stays."""
    return replace(vent(state), fed_ns=None, cause=state.cause or cause)


def vent(state: BoardState) -> BoardState:
    """Set every set point to 0 Pa."""
    return replace(state, setpoint_pa=(0,) * len(state.setpoint_pa))


def _set(
    rules: Rules, state: BoardState, frame: BoardFrame, now_ns: int
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


def refusal(frame: BoardFrame, why: Refusal, port: int) -> BoardFrame:
    """Return the answer to a refused frame.

    Parameters
    ----------
    frame : BoardFrame
        Frame of the host.
    why : Refusal
        Reason.
    port : int
        Port of the reason.
    """
    return BoardFrame(FrameType.REFUSED, frame.sequence, messages.pack_refused(why, port))
