"""Every cell of the loop's part of the table of extremes ends as was stated for it."""

import pytest

from tests.apparatus.extremes.loop_cells import loop_cells

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("cell", [cell for cell in loop_cells() if cell.quick], ids=str)
def test_it_ends_as_stated(cell):
    verdict = cell.run()
    assert cell.must.allows(verdict.outcome), (
        f"must {cell.must.value}: {verdict.outcome.value}, {verdict.note}"
    )
