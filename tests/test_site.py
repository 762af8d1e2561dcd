"""The documentation site is made without a warning or a request, with every page, key and name."""

from __future__ import annotations

import html
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from project import ROOT

import delam_fem as df
from delam_fem.api import tables
from delam_fem.case.keys import case_schema

pytest.importorskip("furo", reason="no sphinx")
pytestmark = [pytest.mark.once, pytest.mark.nightly]
DOCS = ROOT / "docs"
OPTIONS = ["-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
LONGEST = 300  # s
FETCHED = re.compile(r"<(?:script|img|iframe|link)[^>]*(?:src|href)=\"https?:", re.IGNORECASE)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the site in a folder of its own; a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, *OPTIONS, "-d", str(folder / "trees"), str(DOCS), str(folder / "html")],
        env={**os.environ, "PYTHONPATH": str(ROOT), "no_proxy": "*"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_every_page_is_there_and_fetches_nothing(site: Path) -> None:
    sources = [p.relative_to(DOCS) for p in DOCS.rglob("*.md") if "_build" not in p.parts]
    assert len(sources) > 20
    for source in sources:
        text = (site / source).with_suffix(".html").read_text(encoding="utf-8")
        assert not FETCHED.findall(text), source


def test_every_page_can_be_reached_from_the_contents(site: Path) -> None:
    contents = (site / "index.html").read_text(encoding="utf-8")
    for source in DOCS.rglob("*.md"):
        address = source.relative_to(DOCS).with_suffix(".html").as_posix()
        if "_build" not in source.parts and address != "index.html":
            assert f'href="{address}"' in contents, address


def test_every_key_is_listed_with_its_unit(site: Path) -> None:
    text = html.unescape((site / "reference" / "keys.html").read_text(encoding="utf-8"))
    for table in tables():
        assert not table.name or table.heading in text
        for key in table.keys:
            assert f'<span class="pre">{key.name}</span>' in text
            assert not key.unit or f"<p>{key.unit}</p>" in text


def test_every_public_name_is_documented(site: Path) -> None:
    text = (site / "reference" / "api.html").read_text(encoding="utf-8")
    missing = [n for n in df.__all__ if n != "__version__" and f'id="delam_fem.{n}"' not in text]
    assert not missing


def test_the_schema_lies_beside_the_pages(site: Path) -> None:
    assert json.loads((site / "case.schema.json").read_text(encoding="utf-8")) == case_schema()
