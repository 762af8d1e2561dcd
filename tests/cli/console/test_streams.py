"""Streams whose reader has gone."""

import os
import sys
from pathlib import Path

import pytest

from delam_fem.cli.console import lasting_streams


def test_a_stream_without_a_reader_drops_what_it_gets(
    capfd: pytest.CaptureFixture[str],
) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as broken, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", broken)
        with lasting_streams():
            assert sys.stdout is not broken
            for _ in range(3):
                sys.stdout.write("a line\n")
        assert sys.stdout is broken


def test_what_is_written_arrives_at_once(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    with path.open("w", encoding="utf-8") as file, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stderr", file)
        with lasting_streams():
            sys.stderr.write("Δt\n")
            assert path.read_text("utf-8") == "Δt\n"


def test_a_stream_in_memory_is_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    stream = sys.stdout
    with lasting_streams():
        assert sys.stdout is stream
