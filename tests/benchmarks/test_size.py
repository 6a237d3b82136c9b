"""The counter of lines, and bounds of what has been reached: they may only be lowered."""

import pytest

from benchmarks.size import PACKAGES, code_lines, size_of

MOST_FILES, MOST_WIDE = 15, 60


def test_code_is_neither_comment_nor_docstring():
    text = '"""Doc.\n\nMore."""\n\n# why\nx = """a\nb"""  # yes\n\n\ndef f():\n    """Doc."""\n    return x\n'
    assert code_lines(text) == 4


@pytest.mark.slow
def test_no_folder_is_too_full_and_no_more_functions_are_wide():
    sizes = [size_of(package) for package in PACKAGES]
    assert max(size.largest for size in sizes) <= MOST_FILES
    assert sum(size.wide for size in sizes) <= MOST_WIDE
