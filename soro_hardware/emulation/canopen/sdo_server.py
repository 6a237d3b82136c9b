"""SDO server of an emulated node; each refusal has its abort code.

Reads are expedited, because no object has more than four bytes. Writes are expedited or segmented; CiA 301
allows segments for objects of any size. The server refuses block transfers.
"""

from __future__ import annotations

from dataclasses import dataclass

from soro_hardware.canopen.sdo_frames import (
    SdoAbort,
    SdoDownload,
    SdoRequest,
    SdoSegment,
    parse_sdo_request,
    sdo_abort,
    sdo_read_reply,
    sdo_segment_reply,
    sdo_write_reply,
)
from soro_hardware.emulation.canopen.dictionary import ObjectDictionary, Refused
from soro_hardware.transport.frame import Frame

TIMEOUT_NS = 1_000_000_000  # longest time [ns] between two segments, as in CANopenNode
_LONGEST = 4  # largest size of an object [bytes]


@dataclass
class _Download:
    """A segmented write in progress."""

    index: int
    sub: int
    size: int | None  # as announced
    received_ns: int
    toggle: int = 0
    data: bytes = b""


class SdoServer:
    """Answers one client at a time.

    Parameters
    ----------
    node : int
        Node id.
    dictionary : ObjectDictionary
        Objects of the node.
    """

    def __init__(self, node: int, dictionary: ObjectDictionary) -> None:
        self._node, self._dictionary = node, dictionary
        self._download: _Download | None = None

    def reset(self) -> None:
        """Abandon a transfer in progress."""
        self._download = None

    def serve(self, data: bytes, now_ns: int) -> Frame | None:
        """Return the answer to a request; None for a client's abort and for a frame of the wrong length."""
        download, self._download = self._download, None
        if len(data) != 8 or data[0] == 0x80:
            return None
        if download is not None and now_ns - download.received_ns > TIMEOUT_NS:
            download = None  # its client does not continue
        index, sub = int.from_bytes(data[1:3], "little"), data[3]
        request = parse_sdo_request(data)
        try:
            if download is not None:
                index, sub = download.index, download.sub
                return self._continue(download, request, now_ns)
            return self._begin(request, now_ns)
        except Refused as refusal:
            return sdo_abort(self._node, index, sub, refusal.code)

    def _begin(self, request: SdoRequest | SdoDownload | SdoSegment | SdoAbort, now_ns: int) -> Frame:
        if isinstance(request, SdoDownload):
            self._dictionary.writable(request.index, request.sub)
            self._download = _Download(request.index, request.sub, request.size, now_ns)
            return sdo_write_reply(self._node, request.index, request.sub)
        if not isinstance(request, SdoRequest):  # a segment without a transfer, or an unknown service
            raise Refused(SdoAbort.COMMAND)
        index, sub = request.index, request.sub
        if request.data is None:
            return sdo_read_reply(self._node, index, sub, self._dictionary.read(index, sub))
        self._dictionary.write(index, sub, request.data)
        return sdo_write_reply(self._node, index, sub)

    def _continue(
        self, download: _Download, request: SdoRequest | SdoDownload | SdoSegment | SdoAbort, now_ns: int
    ) -> Frame:
        if not isinstance(request, SdoSegment):
            raise Refused(SdoAbort.COMMAND)
        if request.toggle != download.toggle:
            raise Refused(SdoAbort.TOGGLE)
        download.data += request.data
        if len(download.data) > _LONGEST:
            raise Refused(SdoAbort.LENGTH)
        if not request.is_last:
            download.toggle, download.received_ns = 1 - download.toggle, now_ns
            self._download = download
        elif download.size in (None, len(download.data)):
            self._dictionary.write(download.index, download.sub, download.data)
        else:
            raise Refused(SdoAbort.LENGTH)
        return sdo_segment_reply(self._node, request.toggle)
