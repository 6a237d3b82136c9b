"""SDO server of an emulated node: expedited transfers, every refusal with its abort code."""

from __future__ import annotations

from soro_core.hardware.canopen.frames import (
    SdoAbort,
    parse_sdo_request,
    sdo_abort,
    sdo_read_reply,
    sdo_write_reply,
)
from soro_core.hardware.emulation.dictionary import ObjectDictionary, Refused
from soro_core.hardware.transport.frame import Frame


def serve(node: int, dictionary: ObjectDictionary, data: bytes) -> Frame | None:
    """Answer one request; a client's abort and a frame of the wrong length get none."""
    if len(data) != 8 or data[0] == 0x80:
        return None
    request = parse_sdo_request(data)
    if isinstance(request, SdoAbort):
        return sdo_abort(node, int.from_bytes(data[1:3], "little"), data[3], request)
    index, sub = request.index, request.sub
    try:
        if request.data is None:
            return sdo_read_reply(node, index, sub, dictionary.read(index, sub))
        dictionary.write(index, sub, request.data)
    except Refused as refusal:
        return sdo_abort(node, index, sub, refusal.code)
    return sdo_write_reply(node, index, sub)
