"""What a notebook shows of a result: the verdict, its warnings, and its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.results.figures.style import title
from delam_fem.results.pages import html, numbers, verdict
from delam_fem.results.pages.html import Block, Paragraph, Table


def of_result(history: xr.Dataset, summary: Mapping[str, Any], case: Case) -> str:
    """Return a result as a piece of HTML, without style and scripts."""
    names = [str(name) for name in history["lamina"].to_numpy()]
    blocks: list[Block] = [
        Paragraph(title(case)),
        Paragraph(verdict.sentence(history, summary, case)),
        *(Paragraph(str(text)) for text in summary.get("warnings", ())),
        Table(("", "value", "meaning"), numbers.rows(summary, names)),
    ]
    return html.fragment(blocks)
