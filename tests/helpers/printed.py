"""Is what was printed then what is printed now?  The words the same, the numbers alike: machines round differently."""

import re

import numpy as np

NUMBER = re.compile(r"(?<![\w.])[-+±]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")
SAME = 0.02
"""By which a number may differ, relatively; and by two in the last digit printed."""

SAME_PICTURE = 0.5
"""By which pixels may differ on average, of 255: fonts and machines round differently."""


def words(line):
    """A line without its numbers, and without the blanks that align them."""
    return " ".join(NUMBER.sub("#", line).split())


def differences(before, after, skip=None):
    """The pairs of lines that are not alike; `skip` is a pattern of lines that may differ, such as those with times."""
    pairs = zip(before.strip().splitlines(), after.strip().splitlines(), strict=True)
    kept = ((a, b) for a, b in pairs if not (skip and re.search(skip, a)))
    return [
        (a, b) for a, b in kept if words(a) != words(b) or not all(map(alike, NUMBER.findall(a), NUMBER.findall(b)))
    ]


def alike(a, b):
    """Within some per cent, or two of the last digit; where it is next to nothing (1.2e-10), only that it is."""
    x, y = (float(text.replace(",", "").replace("±", "")) for text in (a, b))
    digit = 10.0 ** -len(a.partition("e")[0].partition(".")[2])
    return abs(x - y) <= max(SAME * abs(x), 2 * digit if "e" not in a else 1e-6)


def far_apart(shown, drawn):
    """Whether two pictures are not alike: of other sizes, or by more than fonts do."""
    if shown.size != drawn.size:
        return True
    return bool(np.abs(np.asarray(shown, float) - np.asarray(drawn, float)).mean() > SAME_PICTURE)
