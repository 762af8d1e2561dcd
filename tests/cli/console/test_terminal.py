"""What commands print on a terminal."""

import pytest

from delam_fem.cli.console import table


def test_units_in_brackets_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    table("a [b]title[/b]", ("x [m]", "y"), [("tip [mm]", "[s]")])
    output = capsys.readouterr().out
    assert all(text in output for text in ("[b]title[/b]", "x [m]", "tip [mm]", "[s]"))
