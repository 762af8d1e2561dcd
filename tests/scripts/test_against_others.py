"""The numbers of others: the cases are within the bars, and the page shows what comes out."""

from __future__ import annotations

import re

import pytest
from project import script

others = script("against_others")


RODS = [test for test in others.TESTS if test.file == "rod.toml"]
LONG = [
    pytest.param(test, marks=pytest.mark.nightly if test in RODS[:-1] else ())
    for test in others.TESTS
]


@pytest.mark.parametrize("test", LONG, ids=lambda test: test.file)
def test_numbers_are_within_the_bar_and_on_the_page(test: others.Test) -> None:
    text = others.PAGE.read_text("utf-8")
    for row in test.rows():
        assert abs(row.difference) < others.BAR, row
        shown = re.search(rf"{re.escape(row.what)} \| {row.theirs:.7g} \| (\S+) \|", text)
        assert shown is not None
        assert float(shown[1]) == pytest.approx(row.ours, rel=1e-5)
        assert f"`{row.command}`" in text
