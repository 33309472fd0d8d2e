"""Two pages for the front of the site: that of a fit, made while the site is built, so never stale; that opens a file.

The commands are those of the README's first example; what they write is thrown away but for ``report.html``.
"""

import contextlib
import io
import tempfile
from pathlib import Path

NAME, OPEN = "example-report.html", "open.html"

RELEASE = (
    "simulate srv02-rotpen --friction --set b_alpha=5e-4 --order lambda=0.93 --order mu=0.96 --initial alpha=60deg "
    "--hold 1 --end 7 --step 4ms --noise 0.05deg --counts 4096 --to release.csv"
)


def example_report():
    """The page, as text."""
    import fracid
    from fracid.cli.app import main

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for command in (RELEASE, "init release.csv --yes"):
            with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
                main(command.split())
        finished = fracid.run("release.toml", out="release", jobs=2, figures=False)
        return fracid.write_report(finished.folder, finished.fit, finished.project).read_text(encoding="utf-8")


def _finished(app, exception):
    if exception is None and app.builder.format == "html":
        from fracid.report.open import open_page_text

        (Path(app.outdir) / NAME).write_text(example_report(), encoding="utf-8")
        (Path(app.outdir) / OPEN).write_text(open_page_text(), encoding="utf-8")


def setup(app):
    """Write the pages beside the finished ones."""
    app.connect("build-finished", _finished, priority=400)  # before the site is searched for what it would fetch
    return {"parallel_read_safe": True, "parallel_write_safe": True}
