"""Excerpts beside what a search finds, from files too: the pages' text in one script that the search page alone loads.

Sphinx fetches each page that it has found and cuts a line out of it; no browser fetches files.  So the text of the
pages, section by section, lies beside the index of the search, and the search page's ``fetch`` answers from there.
"""

import json
from html.parser import HTMLParser
from pathlib import Path

SCRIPT = "excerpts.js"

FETCH = """
window.fetch = (url) => {
  const page = String(url).replace(/^(\\.\\.?\\/)*/, "").replace(/\\.html.*$/, "");
  return Promise.resolve({ text: () => Promise.resolve(EXCERPTS[page] || "") });
};
"""


class Sections(HTMLParser):
    """Collects the text of a page's article as sections with their names, nothing else of it."""

    SKIPPED = ("script", "style", "svg", "math", "nav")

    def __init__(self, page):
        super().__init__()
        self.kept, self.depth, self.skipped = [], 0, 0
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        """Enter the article, a section of it, or what is skipped."""
        if tag == "article":
            self.depth += 1
        name = dict(attrs).get("id")
        self.skipped += tag in self.SKIPPED
        if self.depth and tag == "section":
            self.kept.append(f'<section id="{name}">')
        elif self.depth and name and not self.skipped:
            self.kept.append(f'<span id="{name}"></span>')

    def handle_endtag(self, tag):
        """Leave it."""
        self.skipped -= tag in self.SKIPPED and self.skipped > 0
        if self.depth and tag == "section":
            self.kept.append("</section>")
        self.depth -= tag == "article" and self.depth > 0

    def handle_data(self, data):
        """Keep text, with one space for any."""
        if self.depth and not self.skipped and data not in ("#", "¶"):
            self.kept.append(" ".join(data.split()).replace("&", "&amp;").replace("<", "&lt;") + " ")


def sections(page):
    """Return a page's article as little HTML: its sections and their text."""
    return f'<div role="main">{"".join(Sections(page).kept)}</div>'


def _finished(app, exception):
    if exception is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir)
    texts = {
        name: sections((folder / f"{name}.html").read_text(encoding="utf-8"))
        for name in sorted(app.env.found_docs) if (folder / f"{name}.html").is_file()
    }  # fmt: skip
    script = f"const EXCERPTS = {json.dumps(texts, ensure_ascii=False)};\n{FETCH}"
    (folder / "_static" / SCRIPT).write_text(script, encoding="utf-8")


def _page(app, name, _template, _context, _doctree):
    if name == "search":
        app.add_js_file(SCRIPT, priority=400)


def setup(app):
    """Write the script when the pages are there; only the search page loads it."""
    app.connect("html-page-context", _page)
    app.connect("build-finished", _finished)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
