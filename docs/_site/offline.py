"""The finished site asks nobody for anything: no script, style, font or picture from elsewhere, or the build fails."""

import re
from html.parser import HTMLParser
from pathlib import Path

ELSEWHERE = re.compile(r"^\s*(?:[a-z]+:)?//", re.IGNORECASE)
IN_STYLE = re.compile(r"""(?:@import\s+|url\()\s*["']?\s*((?:[a-z]+:)?//[^"')\s]+)""", re.IGNORECASE)


class Fetched(HTMLParser):
    """Collects what a browser fetches by itself when it opens the page; a link that one may follow is not that."""

    def __init__(self, page):
        super().__init__()
        self.found = []
        self.in_style = False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        """Look at the attributes that are fetched."""
        self.in_style = tag == "style"
        for name, value in attrs:
            fetched = name in ("src", "srcset", "poster", "data") or (name in ("href", "xlink:href") and tag != "a")
            if fetched and ELSEWHERE.match(value or ""):
                self.found.append(value)
            if name == "style":
                self.found += IN_STYLE.findall(value or "")

    def handle_endtag(self, tag):  # noqa: ARG002
        """Leave a style sheet."""
        self.in_style = False

    def handle_data(self, data):
        """Look into a style sheet in the page."""
        if self.in_style:
            self.found += IN_STYLE.findall(data)


def fetched_from_elsewhere(folder):
    """Return {file: addresses} of all that the site's pages and style sheets would fetch from elsewhere."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.suffix == ".html":
            addresses = Fetched(path.read_text(encoding="utf-8")).found
        elif path.suffix in (".css", ".svg"):
            addresses = IN_STYLE.findall(path.read_text(encoding="utf-8"))
        else:
            continue
        if addresses:
            found[str(path)] = addresses
    return found


def _finished(app, exception):
    from sphinx.errors import ExtensionError

    if exception is None and app.builder.format == "html" and (found := fetched_from_elsewhere(app.outdir)):
        raise ExtensionError(f"the site would fetch from elsewhere: {found}")


def setup(app):
    """Look at the finished site."""
    app.connect("build-finished", _finished)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
