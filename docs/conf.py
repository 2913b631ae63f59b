"""The site of the documents by Sphinx, from the Markdown files as they are: `make docs`."""

import re
import sys
from html import escape
from pathlib import Path
from typing import cast

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

ROOT = Path(__file__).parent.parent
# The packages of this clone, wherever the environment has its own.
sys.path[:0] = map(str, (ROOT, ROOT / "scripts", *ROOT.glob("clients/*/")))

import command_reference  # noqa: E402
import python_reference  # noqa: E402

project = "gaitd"
author = copyright = "the authors of gaitd, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/index"
include_patterns = [
    "*.md",
    "docs/*.md",
    "docs/evidence/*.md",
    "docs/evidence/two_legs/*.md",
    "clients/*/README.md",
]
nitpicky = True
# Types of signatures: those of other packages have no page.
nitpick_ignore_regex = [("py:.*", ".*")]
default_role = "code"  # of docstrings, which mark code as Markdown does
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
add_module_names = False
toc_object_entries = False
highlight_language = "text"
html_theme = "furo"
html_css_files = ["site.css"]
html_title = "gaitd"
html_copy_source = html_show_sphinx = False
myst_enable_extensions = ["alert"]  # boxes, as on GitHub
myst_heading_anchors = 4  # as on GitHub

MERMAID = Path(sys.prefix, "share/mermaid/mermaid.min.js")
"""`make docs` brings it here; without it the drawings stay text."""
DRAW = """
const theme = document.body.dataset.theme;
const night = matchMedia("(prefers-color-scheme: dark)").matches;
const dark = theme === "dark" || theme !== "light" && night;
mermaid.initialize({theme: dark ? "dark" : "neutral"});
"""
MADE = {
    "docs/command_line": command_reference.reference,
    "docs/python_api": python_reference.reference,
}
"""Pages of which the site has more than the repository: what the code says of itself."""
html_static_path = ["site.css", *([str(MERMAID)] if MERMAID.is_file() else [])]
INDICES = root_doc, "docs/evidence/README"
LINK = re.compile(r"\]\((?!https?:)([^)#]+\.md)\)")


def add_contents(_app: Sphinx, page: str, source: list[str]) -> None:
    """Make the site's navigation of the links below each heading of the two indices."""
    if page not in INDICES:
        return
    for section in re.split(r"^## ", source[0], flags=re.MULTILINE)[1:]:
        heading = section.partition("\n")[0]
        pages = dict.fromkeys(LINK.findall(section))
        source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n"
        source[0] += "\n".join(pages) + "\n```\n"


def add_reference(_app: Sphinx, page: str, source: list[str]) -> None:
    """Put below a page what is made from the code."""
    if page in MADE:
        source[0] += f"\n{MADE[page]()}\n"


def draw(
    app: Sphinx, _page: str, _template: str, _context: object, tree: nodes.Node | None
) -> None:
    """Load the script that draws on the pages that have a drawing."""
    if tree is not None and any(tree.findall(is_drawing)):
        app.add_js_file(MERMAID.name)
        app.add_js_file(None, body=DRAW)


def is_drawing(node: nodes.Node) -> bool:
    """True for a block of Mermaid."""
    return isinstance(node, nodes.raw) and 'class="mermaid"' in node.astext()


def mark_drawings(_app: Sphinx, tree: nodes.document, _page: str) -> None:
    """Make blocks of Mermaid what its script finds."""
    for block in tuple(tree.findall(nodes.literal_block)):
        if block.get("language") == "mermaid":
            text = f'<pre class="mermaid">{escape(block.astext())}</pre>'
            block.replace_self(nodes.raw("", text, format="html"))


def remove_alias(*event: object) -> None:
    """Remove what Python writes below a field of a named tuple that has no text of its own."""
    lines = cast("list[str]", event[-1])
    if lines and lines[0].startswith("Alias for field number"):
        lines.clear()


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.add_lexer("mermaid", TextLexer)
    if MERMAID.is_file():
        app.connect("doctree-resolved", mark_drawings)
        app.connect("html-page-context", draw)
    app.connect("source-read", add_contents)
    app.connect("source-read", add_reference)
    app.connect("autodoc-process-docstring", remove_alias)
    Path(app.outdir, "index.html").write_text(
        '<meta http-equiv="refresh" content="0; url=docs/index.html">\n', encoding="utf-8"
    )
