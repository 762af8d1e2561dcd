"""The documentation site: how Sphinx makes it from the pages of this folder.

The tables of `reference/keys.md` are written while the site is made, from the models of a case. The
JSON schema of a case file is put beside the pages.
"""

import json
from importlib import metadata
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import delam_fem
from delam_fem.case.keys import Key, KeyTable, case_schema, tables

project = "delam_fem"
author = "the authors of delam_fem"
release = metadata.version("delam_fem")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = "delam_fem"
html_copy_source = False
html_show_sphinx = False

myst_heading_anchors = 4  # links to headings as GitHub writes them
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"

autodoc_class_signature = "separated"
autodoc_type_aliases = {name: name for name in ("BoolArray", "FloatArray", "IntArray")}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [
    ("Source", "references_style"),
    *(
        (section, "params_style")
        for section in ("Options", "With a case also", "With operators also")
    ),
]

PLACE = "further pages"
NAMES = ".. further names"
MARK = "<!-- the tables of all keys are put here -->"
SCHEMA = "case.schema.json"


def _cell(text: str) -> str:
    """Return a text for a cell of a table."""
    return text.replace("|", "\\|").replace("<", "&lt;")


def _default(key: Key) -> str:
    """Return what a key has where it is not given."""
    if key.is_required:
        return "**required**"
    return "–" if key.default is None else f"`{json.dumps(key.default, default=str)}`"


def _section(table: KeyTable) -> str:
    """Return the section of a table: its heading, its meaning and its keys."""
    name = f"`{table.heading}`" if table.name else "Before the first table"
    kind = f' with `kind = "{table.kind}"`' if table.kind else ""
    rows = [
        f"| `{key.name}` | {_cell(key.type)} | {_cell(key.unit)} | {_default(key)} "
        f"| {_cell(key.meaning)} |"
        for key in table.keys
    ]
    heading = ["| key | takes | unit | default | meaning |", "|---|---|---|---|---|"]
    return "\n".join([f"## {name}{kind}", "", table.meaning, "", *heading, *rows, ""])


def write_keys(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the tables of all keys into their page."""
    if MARK in source[0]:
        source[0] = source[0].replace(MARK, "\n".join(_section(table) for table in tables()))


def list_all(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the pages that the contents do not name yet into their last part."""
    if docname == "index":
        named = {docname, *source[0].split()}
        others = sorted(page for page in app.project.docnames if page not in named)
        source[0] = source[0].replace(PLACE, "\n".join(others))


def name_all(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the public names that the page of the interface does not have into its last part."""
    if docname == "reference/api":
        others = [name for name in delam_fem.__all__ if f":: {name}\n" not in source[0]]
        rows = [f".. auto{_kind(name)}:: {name}" for name in others if name != "__version__"]
        source[0] = source[0].replace(NAMES, "\n".join(rows))


def _kind(name: str) -> str:
    """Return what a public name is, as directives call it."""
    value = getattr(delam_fem, name)
    return "class" if isinstance(value, type) else "function" if callable(value) else "data"


def write_schema(app: Sphinx, error: Exception | None) -> None:
    """Put the JSON schema of a case file beside the pages."""
    if error is None:
        text = json.dumps(case_schema(), indent=1, ensure_ascii=False)
        (Path(app.outdir) / SCHEMA).write_text(text + "\n", encoding="utf-8")


def keep_methods(app: Sphinx, *given: object) -> None:
    """Let newton@moreau-jean be a method in docstrings, not an address of mail."""
    lines = given[-1]
    assert isinstance(lines, list)
    lines[:] = [line.replace("@", "\\@") for line in lines]


def show_inline(writer: HTML5Translator, node: nodes.math) -> None:
    """Write a formula of a line as MathML, which browsers show without a script."""
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def show_block(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula of its own as MathML."""
    writer.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register what is written while the site is made."""
    app.add_html_math_renderer("mathml", (show_inline, None), (show_block, None))
    app.connect("autodoc-process-docstring", keep_methods)
    app.connect("source-read", write_keys)
    app.connect("source-read", list_all)
    app.connect("source-read", name_all)
    app.connect("build-finished", write_schema)
    return {"parallel_read_safe": True}
