"""CITATION.cff is a valid citation file and says what pyproject.toml says."""

from __future__ import annotations

import re
import tomllib

import pytest
from project import ROOT

TEXT = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
REQUIRED = {"cff-version", "message", "title", "authors"}
"""Keys that version 1.2.0 of the format demands."""
KNOWN = REQUIRED | {"type", "abstract", "version", "license", "keywords"}


def project() -> dict[str, object]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        table: dict[str, object] = tomllib.load(file)["project"]
    return table


def value(key: str) -> str:
    """Return the value of a key of one line, without quotes."""
    match = re.search(rf"^{key}: +(\S.*)$", TEXT, re.MULTILINE)
    assert match is not None, key
    return match[1].strip('"')


def items(key: str) -> list[str]:
    """Return the items of a list."""
    match = re.search(rf"^{key}:\n((?:  - .*\n)+)", TEXT, re.MULTILINE)
    assert match is not None, key
    return [line.removeprefix("  - ") for line in match[1].splitlines()]


def test_keys_are_those_of_the_format() -> None:
    keys = re.findall(r"^([\w-]+):", TEXT, re.MULTILINE)
    assert len(keys) == len(set(keys))
    assert REQUIRED <= set(keys) <= KNOWN
    assert value("cff-version") == "1.2.0"
    assert value("type") == "software"
    assert items("authors") == ["name: The delam_fem developers"]


def test_it_says_what_the_package_says() -> None:
    assert value("version") == project()["version"]
    assert value("license") == project()["license"]
    assert items("keywords") == project()["keywords"]


def test_it_is_yaml() -> None:
    yaml = pytest.importorskip("yaml")
    data = yaml.safe_load(TEXT)
    assert set(data) <= KNOWN
    assert data["authors"] == [{"name": "The delam_fem developers"}]
    assert data["title"] == value("title")
    assert isinstance(data["version"], str)
    assert data["abstract"].startswith("delam_fem computes")
