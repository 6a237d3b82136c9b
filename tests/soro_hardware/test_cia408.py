"""The state machine as a table, scaling of pressures, and the codecs of CiA 301."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import (
    ValveState,
    counts_within,
    next_state,
    pascal_per_count,
    state_of,
)
from soro_hardware.canopen.device import Mapped, PdoLayout
from soro_hardware.transport.frame import Frame

S = ValveState
# Control word (bits M H D) -> state that each state goes to: one step up, any number down.
UP_AND_DOWN = {
    # control   INIT        DISABLED    HOLD        ACTIVE
    0b000: (S.INIT, S.INIT, S.INIT, S.INIT),
    0b001: (S.DISABLED, S.DISABLED, S.DISABLED, S.DISABLED),
    0b011: (S.DISABLED, S.HOLD, S.HOLD, S.HOLD),
    0b111: (S.DISABLED, S.HOLD, S.ACTIVE, S.ACTIVE),
    0b010: (S.INIT, S.INIT, S.INIT, S.INIT),  # H without D is nothing
    0b100: (S.INIT, S.INIT, S.INIT, S.INIT),
    0b101: (S.DISABLED, S.DISABLED, S.DISABLED, S.DISABLED),
    0b110: (S.INIT, S.INIT, S.INIT, S.INIT),
}
FAULTS = {S.FAULT_HOLD: S.HOLD, S.FAULT_DISABLED: S.DISABLED, S.FAULT_INIT: S.INIT}
STATUS = {
    S.NOT_READY: 0b0000,
    S.INIT: 0b1000,
    S.DISABLED: 0b1001,
    S.HOLD: 0b1011,
    S.ACTIVE: 0b1111,
    S.FAULT_REACTION: 0b0111,
    S.FAULT_HOLD: 0b0011,
    S.FAULT_DISABLED: 0b0001,
    S.FAULT_INIT: 0b0000,
}


def test_way_up_and_down():
    for control, row in UP_AND_DOWN.items():
        for state, wanted in zip((S.INIT, S.DISABLED, S.HOLD, S.ACTIVE), row, strict=True):
            assert next_state(state, control, 0) is wanted, (control, state)


def test_fault_is_left_by_a_reset_edge_only():
    for state, control, previous in product(FAULTS, range(16), (0b0000, 0b0111, 0b1000, 0b1111)):
        edge = bool(control & 8) and not previous & 8
        wanted = FAULTS[state] if edge else state
        assert next_state(state, control, previous) is wanted, (state, control, previous)


def test_states_that_no_control_word_leaves():
    for state, control in product((S.NOT_READY, S.FAULT_REACTION), range(16)):
        assert next_state(state, control, 0) is state, (state, control)


@pytest.mark.parametrize(("state", "bits"), list(STATUS.items()))
def test_status_bits(state, bits):
    assert state.bits == bits
    assert state_of(0x0500 | bits) is (S.FAULT_INIT if bits == 0 else state)
    assert state.is_fault == state.name.startswith("FAULT")


@given(st.lists(st.integers(0, 0xFFFF), max_size=30))
def test_no_way_from_a_fault_to_active_without_an_edge(words):
    state, previous = S.FAULT_HOLD, 0
    for word in words:
        if word & 8 and not previous & 8:
            return
        state, previous = next_state(state, word, previous), word
        assert state is S.FAULT_HOLD


@pytest.mark.parametrize(
    ("unit", "prefix", "full_scale", "pascal"),
    [
        (0x22, 1, None, 10.0),
        (0x22, 0, None, 1.0),
        (0x22, 3, None, 1000.0),
        (0x22, -1, None, 0.1),
        (0x4E, -3, None, 100.0),
        (0x4E, -4, None, 10.0),
        (0x4E, 0, None, 1e5),
        (0x00, 0, 100e3, 100e3 / 16384),
    ],
)
def test_scaling(unit, prefix, full_scale, pascal):
    assert pascal_per_count(unit, prefix, full_scale) == pascal


@pytest.mark.parametrize(
    ("unit", "full_scale", "text"), [(0x01, None, "unit 0x01"), (0, None, "full_scale_pa")]
)
def test_scaling_that_is_not_known(unit, full_scale, text):
    with pytest.raises(ValueError, match=text):
        pascal_per_count(unit, 0, full_scale)


@given(
    st.floats(-100e3, 0), st.floats(1.0, 500e3), st.sampled_from([0.1, 1.0, 10.0, 100.0, 100e3 / 16384, 1e5])
)
def test_counts_stay_within_the_range(minimum, maximum, scale):
    low, high = counts_within(minimum, maximum, scale)
    assert -32768 <= low <= 0 <= high <= 32767
    assert low * scale >= minimum - 1e-6 * scale
    assert high * scale <= maximum + 1e-6 * scale


@given(st.lists(st.sampled_from([8, 16, 32]), max_size=8).filter(lambda bits: sum(bits) <= 64), st.data())
def test_pdo_layout_is_its_own_reverse(bits, data):
    values = tuple(data.draw(st.integers(-(1 << width - 1), (1 << width - 1) - 1)) for width in bits)
    is_signed = [value < 0 or data.draw(st.booleans()) for value in values]
    parts = zip(bits, is_signed, strict=True)
    layout = PdoLayout(tuple(Mapped(0x6000 + n, 0, *part) for n, part in enumerate(parts)))
    packed = layout.pack(values)
    assert len(packed) == sum(bits) // 8
    assert layout.unpack(packed) == values


def test_signed_objects_are_in_twos_complement():
    for is_signed, value in ((False, 0xFFFE), (True, -2)):
        layout = PdoLayout((Mapped(0x6380, 1, 16, is_signed), Mapped(0x6040, 0, 8)))
        assert layout.pack((value, 3)) == bytes.fromhex("FEFF03")
        assert layout.unpack(bytes.fromhex("FEFF03")) == (value, 3)


def test_mapping_entry():
    assert Mapped(0x6380, 1, 16).entry == 0x63800110
    assert Mapped.from_entry(0x60400010) == Mapped(0x6040, 0, 16)


@given(st.binary(max_size=12))
def test_parsers_never_raise(data):
    frames.parse_nmt(data)
    frames.parse_emergency(data)
    sdo_frames.parse_sdo_reply(data)
    sdo_frames.parse_sdo_request(data)


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (frames.nmt(frames.NmtCommand.START, 0), "000 [2] 01 00"),
        (frames.heartbeat(127, frames.NmtState.OPERATIONAL), "77F [1] 05"),
        (sdo_frames.sdo_read(1, 0x1000, 0), "601 [8] 40 00 10 00 00 00 00 00"),
        (sdo_frames.sdo_write(1, 0x6042, 0, b"\x01"), "601 [8] 2F 42 60 00 01 00 00 00"),
        (sdo_frames.sdo_write(1, 0x6380, 1, b"\x10\x27"), "601 [8] 2B 80 63 01 10 27 00 00"),
        (sdo_frames.sdo_write(1, 0x1016, 1, b"\x64\x00\x7f"), "601 [8] 27 16 10 01 64 00 7F 00"),
        (sdo_frames.sdo_write(1, 0x1016, 1, b"\x64\x00\x7f\x00"), "601 [8] 23 16 10 01 64 00 7F 00"),
        (frames.emergency(3, 0x8130, 0x11), "083 [8] 30 81 11 00 00 00 00 00"),
        (Frame(0x18FF0001, b"\x01", extended=True), "18FF0001 [1] 01"),
        (Frame(0x701, remote=True, length=1), "701 [1] R1"),
    ],
)
def test_frame_bytes(frame, text):
    assert str(frame) == text


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF), st.binary(min_size=1, max_size=4))
def test_sdo_codecs_agree(index, sub, data):
    request = sdo_frames.parse_sdo_request(sdo_frames.sdo_write(5, index, sub, data).data)
    assert request == sdo_frames.SdoRequest(index, sub, data)
    reply = sdo_frames.parse_sdo_reply(sdo_frames.sdo_read_reply(5, index, sub, data).data)
    assert reply == sdo_frames.SdoReply(index, sub, data)
