"""The package does not grow unnoticed."""

from __future__ import annotations

import tomllib
from pathlib import Path

from project import script

size = script("size")


def test_no_folder_has_more_statements_than_its_limit() -> None:
    limits = tomllib.loads(size.LIMITS.read_text(encoding="utf-8"))["statements"]
    found = {name: counted.statements for name, counted in size.sizes().items()}
    grown = {k: (n, limits.get(k, 0)) for k, n in found.items() if n > limits.get(k, 0)}
    assert grown == {}, "more than the limits in tests/size.toml: make them fewer, or say why"
    assert set(limits) <= set(found), "folders that are gone"


def test_docstrings_comments_and_blank_lines_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b.py").write_text(
        '"""Text\nof two lines."""\n\n# comment\nx = (\n    1,\n)\n"""What x is."""\n'
        'def f():\n    """Return."""\n    if x:\n        return """a\nb"""\n'
    )
    (tmp_path / "c.py").write_text("import a; import b\n")
    assert size.sizes(tmp_path) == {"a": size.Size(1, 7, 4), "c": size.Size(1, 1, 2)}
