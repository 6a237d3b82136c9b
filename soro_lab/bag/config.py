"""Parameters of the recorder and of the player."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from soro_core.config import Strings
from soro_core.run_keys import Mode, StartKeys


class RecorderConfig(StartKeys):
    """Parameters of the recorder."""

    mode: Mode = Field(
        "real_time",
        description="lockstep: the time of a message is that of /clock when it arrived, 0 before its first; "
        "real_time: that of the node's clock",
    )
    folder: str = Field(
        "", description="folder of the new bag; empty: bag-<date>-<time> in the current folder"
    )
    topics: Strings = Field(
        (),
        description="names or patterns (/arm/*) of the topics to record, empty: all that are not hidden; "
        "'NAME TYPE' subscribes before the first publisher exists, 'NAME TYPE transient_local' also "
        "receives messages published before the recorder is discovered",
    )
    exclude: Strings = Field((), description="names or patterns of topics to leave out")
    compression: Literal["zstd", "lz4", "none"] = Field(
        "zstd", description="compression of the chunks: zstd, lz4 or none"
    )
    flush_s: float = Field(
        0.5, ge=0.05, le=60.0, description="longest recorded time that a crash may lose [s]"
    )
    split_bytes: int = Field(
        0,
        ge=0,
        description="size of a file of the bag, about, from which on a new one is started; 0: one file [B]",
    )
    split_s: float = Field(
        0.0, ge=0.0, le=1e6, description="recorded time after which a new file is started; 0: one file [s]"
    )
    discovery_s: float = Field(0.1, ge=0.02, le=10.0, description="period of the search for new topics [s]")
    buffer_bytes: int = Field(
        2**28, ge=2**16, description="messages are dropped when more waits for the disk [B]"
    )
    paused: bool = Field(False, description="begin paused: ~/resume starts it")
    notes: Strings = Field((), description="'key=value' texts kept in the metadata of the bag")


class PlayerConfig(StartKeys):
    """Parameters of the player."""

    bag: str = Field("", description="folder of a run or of a bag, or an .mcap file")
    rate: float = Field(
        1.0,
        ge=0.0,
        le=1000.0,
        description="times faster than recorded, also while it plays; 0: as fast as readers accept messages",
    )
    start_s: float = Field(
        0.0,
        ge=0.0,
        le=1e9,
        description="offset into the bag at which to begin [s]; while it plays: to go on from there",
    )
    duration_s: float = Field(0.0, ge=0.0, le=1e9, description="recorded time to play [s]; 0: to the end")
    topics: Strings = Field(
        (),
        description="names or patterns (/arm/*) of the topics to play; empty: all but those that end in "
        "/chambers/command or /chambers/commands and would drive valves",
    )
    exclude: Strings = Field((), description="names or patterns of topics to leave out")
    remap: Strings = Field((), description="OLD:=NEW names")
    loop: bool = Field(False, description="begin again at the end, also while it plays")
    paused: bool = Field(False, description="begin paused: ~/resume or a key starts it")
    keyboard: bool = Field(False, description="take keys from the terminal, as soro play does")
    clock: bool = Field(False, description="publish /clock with the recorded time")
    clock_hz: float = Field(100.0, gt=0.0, le=10000.0, description="rate of /clock in recorded time")
    wait_for_subscribers: bool = Field(False, description="begin when every topic has a reader")
    wait_timeout_s: float = Field(30.0, gt=0.0, le=3600.0, description="how long to wait for readers")
