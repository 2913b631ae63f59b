"""The site of the documents by Sphinx, from the Markdown files as they are: `make docs`."""

import re
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

project = "gaitd"
author = copyright = "the authors of gaitd, Apache-2.0"
extensions = ["myst_parser"]
root_doc = "docs/index"
include_patterns = ["*.md", "docs/*.md", "docs/evidence/*.md", "clients/*/README.md"]
nitpicky = True
highlight_language = "text"
html_theme = "furo"
html_static_path = html_css_files = ["site.css"]
html_title = "gaitd"
html_copy_source = html_show_sphinx = False
myst_heading_anchors = 4  # as on GitHub

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


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.add_lexer("mermaid", TextLexer)  # GitHub draws it
    app.connect("source-read", add_contents)
    Path(app.outdir, "index.html").write_text(
        '<meta http-equiv="refresh" content="0; url=docs/index.html">\n', encoding="utf-8"
    )
