"""Object 1006, the period of SYNC: written only where the platform asks; devices watch SYNC at 1.5 of it."""

import pytest
from hardware_bench import Bench, codes, emergencies, platform, single, ticks

from soro_core.errors import ConfigError
from soro_hardware.canopen import frames
from soro_hardware.canopen.frames import NmtState
from soro_hardware.canopen.probe import check_sync
from tests.refused import fails

ASKED = {"canopen": {"sync_period_s": 0.04}}
WRITTEN = "> 601 [8] 23 06 10 00 40 9C 00 00"


def pause(bench, milliseconds):
    """Let time pass for the devices without SYNC or anything else; what they send."""
    bench.bus.frames.clear()
    for _ in range(milliseconds):
        bench.world.tick(bench.world.now_ns + 1_000_000)
    return list(bench.bus.frames)


def test_not_written_unless_asked_for():
    bench = Bench(single())
    bench.driver.configure()
    assert not any(" 06 10 00 " in line for line in bench.bus.take_log())
    bench.run(100, 50e3)
    pause(bench, 40)  # SYNC is eight cycles late
    assert bench.run(20, 50e3).faults == ()


def test_written_when_asked_for_and_a_late_sync_trips():
    bench = Bench(single(**ASKED))
    bench.driver.configure()
    assert WRITTEN in bench.bus.take_log()
    pause(bench, 500)
    assert bench.run(100, 50e3).faults == (), "the watch begins with the first SYNC"
    bench.world.nodes[0].dictionary.values[0x1400, 5] = 0  # SYNC alone is watched
    assert emergencies(pause(bench, 55)) == [], "60 ms after SYNC: its cycle took 5 ms"
    assert emergencies(pause(bench, 1)) == ["8100"], "1.5 of 40 ms"
    result = bench.run(2, 50e3)
    assert ("emergency", "link0/chamber0 (node 1)") in codes(result)
    assert "0x8100" in str(result.faults)
    bench.driver.configure()
    assert bench.run(20, 50e3).faults == ()


def test_a_second_session_begins_its_own_watch():
    """SYNC of the first session has started a watch in the devices, and none comes during a start-up."""
    bench = Bench(single(**ASKED))
    for _ in range(2):
        bench.driver.configure()
        pause(bench, 500)
        assert bench.run(20, 50e3).faults == ()


def test_no_watch_is_left_behind():
    bench = Bench(single(**ASKED))
    bench.driver.configure()
    bench.run(20, 50e3)
    bench.driver.close()
    assert bench.world.nodes[0].dictionary.values[0x1006, 0] == 0
    bench.send(frames.nmt(frames.NmtCommand.PRE_OPERATIONAL, 1))
    assert emergencies(pause(bench, 200)) == []


def test_a_node_watches_sync_from_the_first_one_on(powered):
    powered.sdo("23 06 10 00 88 13 00 00")  # 5 ms
    assert emergencies(pause(powered, 100)) == []
    assert emergencies(ticks(powered, 1)) == [], "5 ms later"
    assert emergencies(pause(powered, 2)) == []
    assert emergencies(pause(powered, 1)) == ["8100"], "later than 7.5 ms"
    assert powered.world.nodes[0].dictionary.values[0x1001, 0] == 0x11
    powered.send(frames.nmt(frames.NmtCommand.START, 1))
    assert powered.world.nodes[0].state is NmtState.PRE_OPERATIONAL
    sent = ticks(powered, 1)
    assert emergencies(sent) == ["0000"], "the error ends with the next SYNC"
    powered.send(frames.nmt(frames.NmtCommand.START, 1))
    assert powered.world.nodes[0].state is NmtState.OPERATIONAL


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        (
            {"sync_period_s": 0.005},
            ("", "canopen.sync_period_s:", "0.03333", "0.005", "rpdo_deadline_s"),
        ),
        ({"sync_period_s": 0.03, "rpdo_deadline_s": 0.06}, ("", "canopen.sync_period_s:", "0.04", "0.03")),
        ({"sync_period_s": 2.0}, ("canopen.sync_period_s",)),
    ],
)
def test_a_period_that_the_deadlines_do_not_justify_is_refused(changes, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        platform(canopen=changes)


def test_the_doctor_names_a_period_that_was_left_behind():
    times = platform().canopen
    (finding,) = check_sync(3, 5000, times)
    assert (finding.name, finding.level) == ("SYNC of node 3", "warn")
    assert "1006 is 5000 us" in finding.found
    assert "7.5 ms" in finding.found
    assert list(check_sync(3, 0, times)) == []
    assert list(check_sync(3, 40_000, times)) == [], "later than the deadline of set points"
    assert list(check_sync(3, 5000, platform(**ASKED).canopen)) == [], "the start-up writes another one"


def test_refused_where_the_device_has_no_such_object():
    mapping = {"device": "aventics_aes", "scaling": FIXED}
    with fails(ConfigError, "0.04", "aventics_aes.eds", "1006", key="sync_period_s"):
        Bench(platform(canopen={"sync_period_s": 0.04, "mapping": mapping}))


FIXED = {"kind": "fixed", "setpoint": {"pa_per_count": 100}, "reading": {"pa_per_count": 100}}
