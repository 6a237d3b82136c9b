"""Every cell of the table of extremes ends as stated for it; the longest run in `tests.apparatus` alone."""

import pytest

from tests.apparatus.extremes.cells import cells

pytestmark = pytest.mark.slow

CELLS = [pytest.param(cell, id=str(cell)) for cell in cells() if cell.quick]


@pytest.mark.parametrize("cell", CELLS)
def test_it_ends_as_stated(cell):
    verdict = cell.run()
    assert cell.must.allows(verdict.outcome), (
        f"must {cell.must.value}: {verdict.outcome.value}, {verdict.note}"
    )
