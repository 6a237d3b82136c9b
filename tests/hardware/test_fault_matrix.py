"""Every fault on every family does what the table states; in lockstep, with the limits as shipped."""

import numpy as np
import pytest

from benchmarks.faults.cells import command, run
from benchmarks.faults.rigs import RIGS, Loop
from benchmarks.faults.rows import CHAMBER, MATRIX, Row
from soro_core.errors import HardwareError
from soro_core.hardware.emulation.faults import KINDS, Injection

CELLS = [pytest.param("canopen_408", row, id=row.fault) for row in MATRIX["canopen_408"]]


@pytest.mark.parametrize(("family", "row"), CELLS)
def test_cell(family, row):
    assert run(family, row).problems == ()


def test_no_word_of_the_vocabulary_is_missing():
    rows = MATRIX["canopen_408"]
    assert {injection.fault for row in rows for injection in row.injections()} == set(KINDS)
    assert len(rows) >= 30


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (Row("stuck_closed", "tolerate"), "tripped: "),
        (Row("drop, p: 0.01", "trip", "x", 100.0), "no trip within"),
        (Row("reboot", "trip", "heartbeat", 100.0), "does not match"),
        (Row("mute", "trip", "stale", 10.0), "bound 10 ms"),
        (Row("duplicate", "tolerate", counts="frames_garbled"), "has not grown"),
        (Row("stuck_open", "trip", "over", 800.0), "still 1"),
    ],
)
def test_the_table_can_fail(row, says):
    assert says in "; ".join(run("canopen_408", row).problems)


@pytest.mark.parametrize("fault", ["sdo_abort", "sdo_timeout"])
def test_a_device_that_lets_nobody_at_its_parameters_does_not_start(fault):
    rig = RIGS["canopen_408"](Row(fault, "tolerate"))
    times = rig.platform.canopen.model_copy(update={"boot_timeout_s": 0.2})
    rig.regulator.platform = rig.platform.model_copy(update={"canopen": times})
    rig.devices.faults.add(Injection(fault=fault, chamber=CHAMBER))
    with pytest.raises(HardwareError, match=r"link0/chamber1 \(node 2\): .*"):
        rig.regulator.configure()
    rig.close()


def test_an_arm_on_another_bus_goes_on():
    row = Row("bus_off", "trip")
    loops = [Loop(RIGS["canopen_408"](row)) for _ in range(2)]
    for loop in loops:
        loop.rig.regulator.configure()
    for cycle in range(400):
        if cycle == 200:
            loops[0].rig.devices.faults.add(row.injections()[0])
        for loop in loops:
            loop.cycle(command(row, cycle * 0.005))
    assert loops[0].state.vented
    assert not loops[1].state.vented
    np.testing.assert_allclose(loops[1].rig.devices.pressure_pa, command(row, 2.0), atol=6e3)
    for loop in loops:
        loop.rig.close()
