"""One MCAP file being written, through the `mcap` library."""

from __future__ import annotations

from typing import IO, Literal

from mcap.records import Attachment
from mcap.writer import CompressionType, Writer

from soro_lab.bag.mcap.part import BagFile
from soro_lab.bag.topics import Topic, qos_to_yaml

Compression = Literal["none", "lz4", "zstd"]
CHUNK_BYTES = 1 << 20


class McapFile:
    """One MCAP file being written; index and footer come with `finish`.

    Parameters
    ----------
    stream : file object
        Binary, open for writing; the caller closes it.
    compression : {"none", "lz4", "zstd"}
        Compression of the chunks.
    chunk_bytes : int
        Uncompressed size at which a chunk is written.
    profile : str
        ``ros2`` for everything that ROS 2 records.
    """

    def __init__(
        self,
        stream: IO[bytes],
        compression: Compression,
        chunk_bytes: int = CHUNK_BYTES,
        profile: str = "ros2",
    ) -> None:
        self._writer = Writer(
            stream, chunk_size=chunk_bytes, compression=CompressionType[compression.upper()]
        )
        self._writer.start(profile=profile, library="soro")
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def add_topic(self, topic: Topic) -> int:
        """Register a topic; return the number of its channel."""
        metadata = {"offered_qos_profiles": qos_to_yaml(topic.qos), "topic_type_hash": topic.type_hash}
        schema = self._schema(topic.type, topic.definition_encoding, topic.definition.encode())
        return self._writer.register_channel(topic.name, topic.serialization_format, schema, metadata)

    def copy_channel(self, part: BagFile, channel_id: int) -> int:
        """Register a copy of another file's channel; return its number in this file."""
        channel = part.channels[channel_id]
        old = part.schemas.get(channel.schema_id)
        schema = self._schema(old.name, old.encoding, old.data) if old else 0
        return self._writer.register_channel(
            channel.topic, channel.message_encoding, schema, channel.metadata
        )

    def write(self, channel: int, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int) -> None:
        """Append one message of a channel; parameters as in `BagWriter.write`."""
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns, sequence)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, values)

    def add_attachment(self, item: Attachment) -> None:
        """Write an attachment."""
        self._writer.add_attachment(item.create_time, item.log_time, item.name, item.media_type, item.data)

    def flush(self) -> None:
        """End the chunk and pass all data to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the index and the footer."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _schema(self, name: str, encoding: str, data: bytes) -> int:
        key = name, encoding, data
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(name, encoding, data)
        return self._schemas[key]
