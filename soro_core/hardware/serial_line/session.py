"""Questions that are waited for: the start-up of a device on its line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from soro_core.errors import HardwareError
from soro_core.hardware.serial_line.channel import shown
from soro_core.hardware.serial_line.config import LineOptions
from soro_core.hardware.serial_line.engine import LineEngine, LineSplitter

TRIES = 3

Value = TypeVar("Value")


class Waiter(Protocol):
    """The driver's time."""

    def now_ns(self) -> int:
        """Time of the line."""

    def wait(self, timeout_s: float) -> None:
        """Let some time pass, at most `timeout_s`, less when bytes come."""


class Session:
    """Start-up dialogue with one device.

    Parameters
    ----------
    engine : LineEngine
        Its line; the engine's own requests rest meanwhile.
    waiter : Waiter
        Lets time pass.
    source : str
        How errors name the device.
    options : LineOptions
        Times.
    """

    def __init__(self, engine: LineEngine, waiter: Waiter, source: str, options: LineOptions) -> None:
        self._engine, self._waiter, self._options = engine, waiter, options
        self.source = source
        self.now_ns = waiter.now_ns

    def ask(self, question: bytes, step: str, read: Callable[[bytes], Value | None]) -> Value:
        """What `read` makes of the answer, one line; asked again while that is None.

        Answers do not say what they answer, and one that was held up comes to the next question.

        Raises
        ------
        HardwareError
            If no good answer comes, again and again.
        """
        said = f"no answer to {TRIES} requests"
        for _ in range(TRIES):
            if (line := self.try_ask(question)) is not None:
                if (found := read(line)) is not None:
                    return found
                said = f"answers {shown(line)}"
        raise self.error(step, said)

    def ask_table(self, question: bytes, step: str, read: Callable[[list[bytes]], Value]) -> Value:
        """What `read` makes of an answer of many lines; asked again while that is a ValueError.

        Raises
        ------
        HardwareError
            If it stays one.
        """
        said = ""
        for _ in range(TRIES):
            try:
                return read(self.try_ask_table(question))
            except ValueError as error:
                said = str(error)
        raise self.error(step, said)

    def try_ask_table(self, question: bytes) -> list[bytes]:
        """Answer of many lines, which ends with silence."""
        self.settle()
        self._engine.port.write(question)
        lines: list[bytes] = []
        splitter = LineSplitter(b"\r\n")
        timeout_s = self._options.answer_timeout_s + len(question) * 0.005
        end_ns = self.now_ns() + round(1e9 * self._options.boot_timeout_s)
        # On a line that is never quiet there is no end of an answer.
        while self.now_ns() < end_ns and (found := self._lines(splitter, timeout_s)):
            lines += found
        return lines

    def try_ask(self, question: bytes) -> bytes | None:
        """Answer of one line, or None if there is none in time."""
        self.settle()
        self._engine.port.write(question)
        found = self._lines(LineSplitter(b"\r\n"), self._options.answer_timeout_s + len(question) * 0.005)
        return found[0] if found else None

    def wait_for_boot(self, question: bytes, limit_s: float) -> None:
        """Ask until something comes back.

        Raises
        ------
        HardwareError
            If nothing does.
        """
        end_ns = self.now_ns() + round(1e9 * limit_s)
        while self.try_ask(question) is None:
            if self.now_ns() > end_ns:
                raise self.error(
                    "boot", f"no answer for {limit_s:g} s; is it powered, on this port, at this rate?"
                )

    def listen(self, duration_s: float) -> bytes:
        """Everything that comes unasked for a while."""
        end_ns = self.now_ns() + round(1e9 * duration_s)
        heard = self._engine.discard(self.now_ns())
        while (left_s := (end_ns - self.now_ns()) * 1e-9) > 0:
            self._waiter.wait(left_s)
            heard += self._engine.port.read()
        return heard

    def settle(self) -> None:
        """Wait until the line has been quiet for a moment, or it never is."""
        for _ in range(20):
            if not self.listen(self._options.quiet_s):
                return

    def in_gap(self, data: bytes) -> None:
        """Send something in the pause after what a device sends by itself."""
        heard = b""
        end_ns = self.now_ns() + 200_000_000
        while not heard.endswith((b"\r", b"\n")) and (left_s := (end_ns - self.now_ns()) * 1e-9) > 0:
            self._waiter.wait(left_s)
            heard += self._engine.port.read()
        self._engine.port.write(data)

    def error(self, step: str, text: str) -> HardwareError:
        """Error that names the device and the step."""
        return HardwareError(f"{self.source}: {step}: {text}")

    def _lines(self, splitter: LineSplitter, timeout_s: float) -> list[bytes]:
        """Lines up to the first pause; none after `timeout_s` without a byte, or of bytes without an end."""
        end_ns = self.now_ns() + round(1e9 * timeout_s)
        last_ns = self.now_ns() + round(1e9 * self._options.boot_timeout_s)
        while True:
            lines = splitter.feed(chunk) if (chunk := self._engine.port.read()) else []
            if lines:
                return lines
            if chunk:
                end_ns = min(self.now_ns() + round(1e9 * timeout_s), last_ns)
            left_s = (end_ns - self.now_ns()) * 1e-9
            if left_s <= 0:
                return []
            self._waiter.wait(left_s)
