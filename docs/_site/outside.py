"""Links out of docs/: a file of the repository is offered beside the page, a folder is only named."""

import re
from pathlib import Path

LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((\.\./[^)#\s]+)\)")


def named(text, folder):
    """Return a page's text with its links to folders outside docs/ as plain words.

    >>> named("see [`examples/`](../examples)", Path("docs"))
    'see `examples/`'
    """
    return LINK.sub(lambda link: link[1] if (folder / link[2]).is_dir() else link[0], text)


def _read(app, page, source):
    source[0] = named(source[0], Path(app.env.doc2path(page)).parent)


def setup(app):
    """Look at every page as it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
