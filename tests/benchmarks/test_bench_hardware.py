"""The sections of the hardware run through, and every device answers; no rate and no time is asserted."""

import pytest
from result_tables import tables, written

from benchmarks.__main__ import SECTIONS
from benchmarks.kills import CASES

pytestmark = [pytest.mark.process, pytest.mark.real_time]


def section(folder, name):
    text = written(folder, name)
    assert f"## {SECTIONS[name].TITLE}" in text
    return tables(text)


def test_rates_of_serial_lines(tmp_path):
    (rows,) = section(tmp_path, "serial_rates")
    assert len(rows) == 2
    for row in rows:
        for column in ("exchanges, Hz", "set points, Hz", "readings, Hz"):
            assert float(row[column]) > 0.0, row


def test_rates_of_boards(tmp_path):
    (rows,) = section(tmp_path, "board")
    assert len(rows) == 3
    for row in rows:
        assert int(row["without fresh reading"]) < int(row["cycles"]), row


def test_a_driver_that_is_stopped_and_continued_leaves_no_pressure(tmp_path):
    ((row,),) = section(tmp_path, "stops")
    assert (row["platform"], row["process"], row["signal"]) == ("emulated_canopen", "driver", "SIGSTOP")
    assert 0.0 < float(row["under pressure: empty after, ms"]) < 1e3
    assert float(row["left, kPa"]) < 2.0


def test_after_a_kill_only_a_reset_brings_pressure_back(tmp_path):
    drivers, devices = section(tmp_path, "kills")
    assert [row["platform"] for row in (*drivers, *devices)] == 2 * list(CASES)[:1]
    assert float(drivers[0]["slowest, ms"]) > 0.0
    assert devices[0]["recovery by reset only"] == "yes (met)"
