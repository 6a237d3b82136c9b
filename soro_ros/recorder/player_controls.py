"""What steers a playback: services, parameters and keys."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from typing import Any

from rclpy.parameter import Parameter

from soro_core.errors import ConfigError
from soro_ros.host.services import create_triggers
from soro_ros.process.lifecycle import SoroNode
from soro_ros.recorder.playback import Playback

_NAMES = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", " ": "space"}
_POLL_S = 0.1


class Keyboard:
    """Calls a function for every key, in a thread; Ctrl-C stays a signal.

    Without a terminal, or in the background of one, there are no keys.

    Parameters
    ----------
    on_key : callable
        Takes the name of a key: space, up, down, left, right, or the letter.
    """

    def __init__(self, on_key: Callable[[str], None]) -> None:
        self._on_key, self._ended = on_key, threading.Event()
        self._fd, self._before = -1, list[Any]()
        self._thread: threading.Thread | None = None
        try:
            self._fd = sys.stdin.fileno()
            if not os.isatty(self._fd) or not self._in_foreground():
                return
            self._before = termios.tcgetattr(self._fd)
        except (OSError, ValueError, AttributeError, termios.error):  # no standard input, or a closed one
            return
        tty.setcbreak(self._fd)
        self._thread = threading.Thread(target=self._run, name="keyboard", daemon=True)
        self._thread.start()

    @property
    def is_there(self) -> bool:
        """Whether there are keys."""
        return self._thread is not None

    def close(self) -> None:
        """Leave the terminal as it was; may be called again."""
        self._ended.set()
        if self._thread is None:
            return
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._thread = None
        if self._in_foreground():
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    def _in_foreground(self) -> bool:
        """Whether the terminal is this program's: one in the background that reads is stopped."""
        return os.tcgetpgrp(self._fd) == os.getpgrp()

    def _run(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([self._fd], [], [], _POLL_S)
            if not ready or not self._in_foreground():
                continue
            text = os.read(self._fd, 64).decode(errors="replace")
            if not text:  # the terminal is gone
                return
            for key in keys(text):
                self._on_key(key)


def keys(text: str) -> list[str]:
    """Return the names of the keys whose bytes a terminal has sent."""
    found, at = [], 0
    while at < len(text):
        size = 3 if text.startswith("\x1b[", at) else 1
        letters = text[at : at + size]
        found.append(_NAMES.get(letters, letters))
        at += size
    return found


_SEEK_S = 5.0
_FASTEST = 1000.0
_HELP = "keys: space pauses, left and right seek by 5 s, up and down change the rate, l the loop, q ends"


class PlayerControls:
    """Services ~/pause, ~/resume, ~/toggle_paused, parameters rate, start_s and loop, and keys.

    Parameters
    ----------
    node : SoroNode
        The player.
    playback : Playback
    start_s : float
        Offset [s] into the bag at which the playback begins.

    Attributes
    ----------
    playback : Playback
        What is steered.
    """

    def __init__(self, node: SoroNode[Any], playback: Playback[Any], start_s: float) -> None:
        self._node, self.playback, self._start_s = node, playback, start_s
        self._keyboard: Keyboard | None = None
        actions = {"pause": self._pause, "resume": self._resume, "toggle_paused": self._toggle}
        create_triggers(node, actions)
        node.add_post_set_parameters_callback(self._apply)

    def listen(self) -> None:
        """Take keys, if there is a terminal."""
        self._keyboard = Keyboard(self._on_key)
        if self._keyboard.is_there:
            self._node.get_logger().info(_HELP)

    def leave_terminal(self) -> None:
        """Leave the terminal as it was."""
        if self._keyboard is not None:
            self._keyboard.close()
            self._keyboard = None

    def close(self) -> None:
        """Take no parameters and keys any more."""
        self.leave_terminal()
        self._node.remove_post_set_parameters_callback(self._apply)

    def _pause(self) -> str:
        self.playback.pause()
        return f"paused at {self._at()}"

    def _resume(self) -> str:
        self.playback.resume()
        return f"playing from {self._at()}"

    def _toggle(self) -> str:
        return self._resume() if self.playback.paused else self._pause()

    def _at(self) -> str:
        return f"{self._start_s + self.playback.position_s:.3f} s"

    def check(self, start_s: float) -> None:
        """Raise ConfigError if the parameter start_s is outside of what is played."""
        last_s = self._start_s + self.playback.length_s
        if not self._start_s <= start_s <= last_s:
            allowed = f"{self._start_s:g} to {last_s:g}, what is played"
            raise ConfigError("parameters of player", "start_s", start_s, allowed)

    def _apply(self, changes: list[Parameter]) -> None:
        for change in changes:
            if change.name == "rate":
                self.playback.set_rate(float(change.value))
            elif change.name == "loop":
                self.playback.loop = change.value
            elif change.name == "start_s":
                self.playback.seek(float(change.value) - self._start_s)

    def _on_key(self, key: str) -> None:
        playback = self.playback
        if key == "space":
            told = self._toggle()
        elif key in ("left", "right"):
            playback.seek(playback.position_s + (_SEEK_S if key == "right" else -_SEEK_S))
            told = f"at {self._at()}"
        elif key in ("up", "down"):
            wanted = playback.rate * (2.0 if key == "up" else 0.5) or 1.0  # from 0, as fast as possible, to 1
            playback.set_rate(min(wanted, _FASTEST))
            told = f"rate {playback.rate:g}"
        elif key == "l":
            playback.loop = not playback.loop
            told = f"loop {'on' if playback.loop else 'off'}"
        elif key == "q":
            playback.stop()
            told = f"ended at {self._at()}"
        else:
            return
        self._node.get_logger().info(told)
