"""Docstrings are read by rows, their further lines included."""

import subprocess
import sys
from dataclasses import dataclass

from delam_fem.system.docstrings import meanings, summary


@dataclass
class Beam:
    """A beam
    on two lines.

    Attributes:
        length: its length,
            from end to end [m].
        mass: its mass: all of it [kg].
    """


class Heavy(Beam):
    """A heavy beam.

    Not a light one.

    Attributes:
        load_2: what it carries [N].
        mass: its large mass [kg].
    Raises:
        nothing: never.
    """


class Bare:
    pass


class Named:
    """Only   a line."""


def test_the_first_line_says_what_a_class_is() -> None:
    assert summary(Beam) == "A beam"
    assert summary(Heavy) == "A heavy beam."
    assert summary(Named) == "Only a line."
    assert summary(Bare) == ""


def test_rows_are_those_of_a_class_and_of_what_it_extends() -> None:
    beam = {"length": "its length, from end to end [m].", "mass": "its mass: all of it [kg]."}
    assert meanings(Beam) == beam
    heavy = beam | {"mass": "its large mass [kg].", "load_2": "what it carries [N]."}
    texts = meanings(Heavy)
    assert {name: texts[name] for name in heavy} == heavy
    assert list(texts)[:3] == ["length", "mass", "load_2"]
    assert meanings(Bare) == meanings(Named) == {}


STRIPPED = """
import json
from delam_fem.case.sections import Contact, Lamina
from delam_fem.system.docstrings import meanings, summary
print(json.dumps([[summary(own), meanings(own)] for own in (Lamina, Contact)]))
"""


def test_docstrings_that_python_strips_are_read_from_the_sources() -> None:
    """What `python -OO` reads is what Python reads."""
    texts = [
        subprocess.run(
            [sys.executable, *flags, "-c", STRIPPED],
            capture_output=True,
            text=True,
            timeout=300,
            check=True,
        ).stdout
        for flags in ((), ("-OO",))
    ]
    assert texts[0] == texts[1]
    assert "thickness h [m]" in texts[0]
