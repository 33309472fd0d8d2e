"""Links out of docs/: a file of the repository is offered beside the page, a folder is only named."""

import re
from pathlib import Path

LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((\.\./[^)#\s]+)\)")


def named(text, docs, folder):
    """Return a page's text with its links to folders outside docs/ as plain words, to Markdown there as files.

    >>> named("see [`examples/`](../examples)", Path("docs"), Path("docs"))
    'see `examples/`'
    """

    def one(link):
        target = (folder / link[2]).resolve()
        if target.is_dir():
            return link[1]
        return link[0] if docs.resolve() in target.parents else f"[{link[1]}](path:{link[2]})"

    return LINK.sub(one, text)


def _read(app, page, source):
    source[0] = named(source[0], Path(app.srcdir), Path(app.env.doc2path(page)).parent)


def setup(app):
    """Look at every page as it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
