"""What every page of fracid's is made with: templates that escape, style sheets, and a Content-Security-Policy."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from fracid.estimation.records import in_words
from fracid.report.sentences import (
    counted,
    digits,
    end_of,
    interval,
    joined,
    letter,
    number,
    search_sentence,
    typeset,
    unit,
    with_error,
)
from fracid.report.whiskers import whisker
from fracid.safety.door import own_text
from fracid.safety.text import printable
from fracid.units import in_letters

if TYPE_CHECKING:
    from jinja2 import Environment

STYLES = ("uPlot.min.css", "page.css", "explore.css")

SEE = {"Fit": "fitted", "Orders": "finding-orders", "Prediction": "finding-prediction", "Checks": "checks",
       "Each recording alone": "alone", "Where the record begins": "begins", "Data": "data",
       "Ladder": "ladder"}  # fmt: skip
"""Headings that a claim refers to → where they stand on the page."""

DARK = "dark.css"
"""A style sheet of its own: its media say when it holds."""


def environment_of_pages() -> Environment:
    """Jinja, which escapes all that is not marked."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    jinja = Environment(
        loader=PackageLoader("fracid.report", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=_seen,
    )  # fmt: skip
    words = (counted, digits, end_of, in_letters, in_words, interval, joined, letter, linked, number, search_sentence,
             unbroken, unit, whisker, with_error)  # fmt: skip
    jinja.filters |= {word.__name__: word for word in words}
    return jinja


def unbroken(sentence: str) -> str:
    """A sentence that breaks at no space before a unit, its powers of ten raised where they are not to be typed.

    Examples
    --------
    >>> unbroken("b fell from 2.4e-03 to 3e-5; type tolerance = 1e-8")
    'b fell from 2.4×10⁻³ to 3×10⁻⁵; type tolerance = 1e-8'
    >>> unbroken("a fit of 95.7 %, 55.79 s at 500 Hz, and 3 sentences").split(" ")
    ['a', 'fit', 'of', '95.7\xa0%,', '55.79\xa0s', 'at', '500\xa0Hz,', 'and', '3', 'sentences']
    """
    raised = re.sub(r"(?<![\w.])(?<!= )\d+(?:\.\d+)?e[-+]?\d+(?!\w|\.\d)", lambda found: typeset(found[0]), sentence)
    return re.sub(r"(?<=\d) (?=(?:%|s|ms|Hz|V|mV|m|A|N|steps?|times)\b|%)", "\N{NO-BREAK SPACE}", raised)


def linked(sentence: str) -> Markup:
    """A sentence whose ``(see Fit)`` leads there.

    Examples
    --------
    >>> linked("It swings < 1°, but b is off (see Each recording alone).")
    Markup('It swings &lt; 1°, but b is off (<a href="#alone">see Each recording alone</a>).')
    """
    text = str(escape(unbroken(printable(sentence))))
    for heading, at in SEE.items():
        text = text.replace(f"(see {heading})", f'(<a href="#{at}">see {heading}</a>)')
    return Markup(text)  # escaped above


def rendered(
    template: str, scripts: Sequence[str | Markup], *, more_styles: Sequence[str] = (), images: bool = False,
    **context: Any,
) -> str:  # fmt: skip
    """A page of a template with its style sheets, its scripts, and the policy that lets these and nothing else act.

    A script is the name of a file beside this one, or the text of one.
    """
    own = [Markup(own_file(name)) for name in (*STYLES, *more_styles)]  # fracid's own
    dark = Markup(own_file(DARK))
    texts = [text if isinstance(text, Markup) else Markup(own_file(text)) for text in scripts]
    allowed = policy([*own, dark], texts, images=images)
    page = environment_of_pages().get_template(template)
    return page.render(styles=own, dark=dark, scripts=texts, policy=allowed, **context)


def _seen(value: Any) -> Any:
    """A text of a run's without what cannot be seen: it could turn the direction of what stands beside it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def own_file(name: str) -> str:
    """A file beside this one, as it stands between a tag and its end."""
    return "\n" + own_text(f"report/{name}").strip() + "\n"


def policy(styles: list[Markup], scripts: list[Markup], *, images: bool = False) -> str:
    """Content-Security-Policy: these styles and scripts, by their hashes, and nothing from anywhere.

    With `images` those that the page holds itself, too.
    """

    def hashes(texts: list[Markup]) -> str:
        return " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in texts)

    allowed = f"style-src {hashes(styles)}; script-src {hashes(scripts)}{'; img-src data:' * images}"
    return f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"
