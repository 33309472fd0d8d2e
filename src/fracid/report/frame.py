"""What every page of fracid's is made with: templates that escape, style sheets, and a Content-Security-Policy."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from fracid.report.drawing import filled
from fracid.report.whiskers import whisker
from fracid.safety.door import own_text

STYLES = ("uPlot.min.css", "page.css", "explore.css")

DARK = "dark.css"
"""A style sheet of its own: its media say when it holds."""


def rendered(
    template: str, scripts: Sequence[str | Markup], *, styles: Sequence[str] = (), images: bool = False, **context: Any
) -> str:
    """A page of a template with its style sheets, its scripts, and the policy that lets these and nothing else act.

    A script is the name of a file beside this one, or the text of one.  The policy allows styles and scripts by their
    hashes, with `images` those that the page holds itself, and nothing from anywhere.
    """
    own, dark = [_own(name) for name in (*STYLES, *styles)], _own(DARK)
    texts = [_own(script) for script in scripts]
    allowed = f"style-src {_hashes([*own, dark])}; script-src {_hashes(texts)}{'; img-src data:' * images}"
    policy = f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"
    return filled(template, styles=own, dark=dark, scripts=texts, policy=policy, whisker=whisker, **context)


def _own(text: str | Markup) -> Markup:
    """A file beside this one, or a text, as it stands between a tag and its end."""
    return Markup(f"\n{(text if isinstance(text, Markup) else own_text(f'report/{text}')).strip()}\n")  # fracid's own


def _hashes(texts: list[Markup]) -> str:
    return " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in texts)
