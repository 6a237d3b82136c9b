"""Every fault on every family does what the table states; in lockstep, with the limits as shipped."""

import numpy as np
import pytest

from soro_core.errors import HardwareError
from soro_hardware.emulation.faults.fault_types import KINDS, Injection
from tests.apparatus.faults import healthy
from tests.apparatus.faults.cells import command, run
from tests.apparatus.faults.flow import LEAK, NARROW, behind_a_twin
from tests.apparatus.faults.matrix import FOUR, MATRIX, air
from tests.apparatus.faults.rigs import Loop, rig_of
from tests.apparatus.faults.rows import CHAMBER, Row
from tests.refused import fails

HEALTHY = Row("", "tolerate")
FAMILIES = [family for family in MATRIX if family != FOUR]


def cells():
    """All rows of CANopen, all of the other families' own, and each row of the air on two of those.

    The rest is the same code again; `python -m tests.apparatus` runs everything.
    """
    for number, family in enumerate(FAMILIES):
        shared = set(air(family))
        for place, row in enumerate(MATRIX[family]):
            if number == 0 or row not in shared or (place + number) % 3 == 0:
                yield pytest.param(family, row, id=f"{family}-{row.fault}")
    for row in MATRIX[FOUR]:
        if row.fault in ("mute", "burst"):
            yield pytest.param(FOUR, row, id=f"4-{row.fault}")


@pytest.mark.slow
@pytest.mark.parametrize(("family", "row"), list(cells()))
def test_cell(family, row):
    assert run(family, row).problems == ()


def on_flow():
    """All rows of valves, lines and chambers on CANopen, on each other family one that needs its vent."""
    rows = [row for row in air("canopen_408", NARROW, LEAK) if not row.fault.startswith("sensor")]
    yield from (("canopen_408", row) for row in rows)
    own = ("stuck_open", "vent_blocked", "leak, rate_1_s: 30", "kinked_line", "burst")
    for family, fault in zip(FAMILIES[1:], own, strict=True):
        yield family, next(row for row in air(family, NARROW, LEAK) if row.fault.startswith(fault))


@pytest.mark.parametrize(("family", "row"), [pytest.param(*c, id=f"{c[0]}-{c[1].fault}") for c in on_flow()])
def test_cell_on_the_flow_into_a_twin(family, row):
    assert run(family, row, air=behind_a_twin).problems == ()


@pytest.mark.process
@pytest.mark.parametrize("family", ["itv_rs232", "alicat", "veab_tcp", "soro_board", "vtem_modbus"])
def test_over_a_real_line(family):
    """Pulled out and put back: the ports of the operating system go and come with it."""
    row = next(row for row in MATRIX[family] if row.fault == "adapter_unplug")
    assert run(family, row, real=True).problems == ()


def test_no_word_of_the_vocabulary_is_missing():
    assert sum(len(rows) for rows in MATRIX.values()) > 150
    for family, rows in MATRIX.items():
        rig = rig_of(family, HEALTHY)
        shown = {injection.fault for row in rows for injection in row.injections()}
        if family != FOUR:
            assert shown == rig.devices.faults.supported, family
            assert len(rows) >= 30
        rig.close()
    assert {i.fault for row in MATRIX["canopen_408"] for i in row.injections()} == set(KINDS)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (Row("stuck_closed", "tolerate"), "tripped: "),
        (Row("drop, p: 0.01", "trip", "x", 100.0), "no trip within"),
        (Row("reboot", "trip", "heartbeat", 100.0), "does not match"),
        (Row("mute", "trip", "stale", 10.0), "bound 10 ms"),
        (Row("duplicate", "tolerate", counts="frames_garbled"), "has not grown"),
        (Row("stuck_open", "trip", "over", 800.0), "still 1"),
        (Row("slow_valve", "trip", "implausible", 800.0, slower=5.0), "still "),
    ],
)
def test_the_table_can_fail(row, says):
    assert says in "; ".join(run("canopen_408", row).problems)


@pytest.mark.parametrize("fault", ["sdo_abort", "sdo_timeout"])
def test_a_device_that_lets_nobody_at_its_parameters_does_not_start(fault):
    rig = rig_of("canopen_408", Row(fault, "tolerate"))
    times = rig.platform.canopen.model_copy(update={"boot_timeout_s": 0.2})
    rig.regulator.platform = rig.platform.model_copy(update={"canopen": times})
    rig.devices.faults.add(Injection(fault=fault, chamber=CHAMBER))
    with fails(HardwareError, device="link0/chamber1 (node 2)"):
        rig.regulator.configure()
    rig.close()


@pytest.mark.parametrize(
    ("family", "fault"),
    list(
        zip(
            FAMILIES,
            ["bus_off", "adapter_unplug", "mute", "stuck_open", "reboot", "brownout, duration_s: 0.3"],
            strict=True,
        )
    ),
)
def test_an_arm_on_another_bus_goes_on(family, fault):
    """All on other buses but in one process: nothing that they share may carry a trip over."""
    row = next(row for row in MATRIX[family] if row.fault == fault)
    beside = Loop(rig_of(family, HEALTHY))
    beside.rig.regulator.configure()
    assert run(family, row, beside=beside).problems == ()
    t = (beside.cycles - 1) * beside.rig.period_s
    np.testing.assert_allclose(beside.rig.devices.pressure_pa, command(HEALTHY, t), atol=9e3)
    beside.rig.close()


def test_a_trip_of_the_arm_beside_is_seen():
    beside = Loop(rig_of("veab_tcp", HEALTHY))
    beside.rig.regulator.configure()
    beside.rig.devices.faults.add(Injection(at=0.5, fault="stuck_open", chamber=CHAMBER))
    assert (
        "the other arm too: over-pressure"
        in run("veab_tcp", Row("duplicate, p: 0.1", "tolerate"), beside=beside).problems[0]
    )
    beside.rig.close()


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_minutes_without_a_fault(family):
    assert healthy(family, 20.0).endswith("no trip.")


@pytest.mark.slow
def test_minutes_without_a_fault_on_a_flow():
    assert healthy("canopen_408", 20.0, behind_a_twin).endswith("no trip.")
