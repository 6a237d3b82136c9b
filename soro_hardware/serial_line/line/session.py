"""Requests with a wait for the answer, for the start-up of a device on its line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from soro_core.errors import HardwareError
from soro_hardware.serial_line.config import LineOptions
from soro_hardware.serial_line.line.port import BytePort
from soro_hardware.serial_line.line.request import LineSplitter, format_bytes

TRIES = 3

Value = TypeVar("Value")


class Waiter(Protocol):
    """Time of the driver."""

    def now_ns(self) -> int:
        """Return the time of the line [ns]."""

    def wait(self, timeout_s: float) -> None:
        """Wait until bytes arrive, at most `timeout_s` [s]."""


class SharedLine(Protocol):
    """The line of some devices, without requests of the control loop."""

    port: BytePort

    def discard(self, now_ns: int) -> bytes:
        """Drop received bytes and the open request; return the bytes."""


class StartupSession:
    """Start-up dialogue with one device.

    Parameters
    ----------
    line : SharedLine
        Line of the device.
    waiter : Waiter
        Time of the driver.
    source : str
        Name of the device in errors.
    options : LineOptions
        Times of the line.
    """

    def __init__(self, line: SharedLine, waiter: Waiter, source: str, options: LineOptions) -> None:
        self._line, self._waiter, self._options = line, waiter, options
        self.source = source
        self.now_ns = waiter.now_ns

    def ask(self, question: bytes, step: str, read: Callable[[bytes], Value | None]) -> Value:
        """Send a request and return its decoded answer of one line; repeat it after an invalid answer.

        An answer does not name its request, and a delayed one arrives after the next request.

        Parameters
        ----------
        question : bytes
        step : str
            Name of the step in errors.
        read : callable
            Decodes the line; returns None for an invalid answer.

        Raises
        ------
        HardwareError
            If no try has a valid answer.
        """
        found, code = f"no answer to {TRIES} requests", "silent"
        for _ in range(TRIES):
            if (line := self.try_ask(question)) is not None:
                if (value := read(line)) is not None:
                    return value
                found, code = f"answers {format_bytes(line)}", "refused"
        raise self.error(step, found, code)

    def ask_table(self, question: bytes, step: str, read: Callable[[list[bytes]], Value]) -> Value:
        """Send a request and return its decoded answer of many lines; repeat it after an invalid answer.

        Parameters
        ----------
        question, step : bytes, str
            As in `StartupSession.ask`.
        read : callable
            Decodes the lines; raises `ValueError` for an invalid answer.

        Raises
        ------
        HardwareError
            If no try has a valid answer.
        """
        reason = ""
        for _ in range(TRIES):
            try:
                return read(self.try_ask_table(question))
            except ValueError as error:
                reason = str(error)
        raise self.error(step, reason)

    def try_ask_table(self, question: bytes) -> list[bytes]:
        """Return an answer of many lines, which ends with a pause."""
        self.settle()
        self._line.port.write(question)
        lines: list[bytes] = []
        splitter = LineSplitter(b"\r\n")
        timeout_s = self._options.answer_timeout_s + len(question) * 0.005
        end_ns = self.now_ns() + round(1e9 * self._options.boot_timeout_s)
        # On a line that is never quiet an answer has no end.
        while self.now_ns() < end_ns and (found := self._lines(splitter, timeout_s)):
            lines += found
        return lines

    def try_ask(self, question: bytes) -> bytes | None:
        """Return an answer of one line, or None without an answer in time."""
        self.settle()
        self._line.port.write(question)
        found = self._lines(LineSplitter(b"\r\n"), self._options.answer_timeout_s + len(question) * 0.005)
        return found[0] if found else None

    def wait_for_boot(self, question: bytes, limit_s: float) -> None:
        """Repeat a request until the device answers.

        Raises
        ------
        HardwareError
            If there is no answer within `limit_s` [s].
        """
        end_ns = self.now_ns() + round(1e9 * limit_s)
        while self.try_ask(question) is None:
            if self.now_ns() > end_ns:
                text = f"no answer for {limit_s:g} s; is it powered, on this port, at this rate?"
                raise self.error("boot", text, "silent")

    def listen(self, duration_s: float) -> bytes:
        """Return the bytes that arrive without a request within `duration_s` [s]."""
        end_ns = self.now_ns() + round(1e9 * duration_s)
        received = self._line.discard(self.now_ns())
        while (left_s := (end_ns - self.now_ns()) * 1e-9) > 0:
            self._waiter.wait(left_s)
            received += self._line.port.read()
        return received

    def settle(self) -> None:
        """Wait until the line is quiet, at most 20 times."""
        for _ in range(20):
            if not self.listen(self._options.quiet_s):
                return

    def in_gap(self, data: bytes) -> None:
        """Send bytes in the pause after a line of a streaming device."""
        received = b""
        end_ns = self.now_ns() + 200_000_000
        while not received.endswith((b"\r", b"\n")) and (left_s := (end_ns - self.now_ns()) * 1e-9) > 0:
            self._waiter.wait(left_s)
            received += self._line.port.read()
        self._line.port.write(data)

    def error(self, step: str, text: str, code: str = "refused") -> HardwareError:
        """Return an error that states the device and the step.

        Parameters
        ----------
        step : str
            Step of the start-up.
        text : str
            What went wrong.
        code : str
            Cause, of `HARDWARE_CODES`.
        """
        return HardwareError(text, self.source, code, step)

    def _lines(self, splitter: LineSplitter, timeout_s: float) -> list[bytes]:
        """Return the lines up to the first pause; none after `timeout_s` [s] or from bytes without an end."""
        end_ns = self.now_ns() + round(1e9 * timeout_s)
        last_ns = self.now_ns() + round(1e9 * self._options.boot_timeout_s)
        while True:
            lines = splitter.feed(chunk) if (chunk := self._line.port.read()) else []
            if lines:
                return lines
            if chunk:
                end_ns = min(self.now_ns() + round(1e9 * timeout_s), last_ns)
            left_s = (end_ns - self.now_ns()) * 1e-9
            if left_s <= 0:
                return []
            self._waiter.wait(left_s)
