"""How values and names are shown to people: angles in degrees, all else in its own unit; ``alpha`` as α.

Inside, everything is SI, angles in radians.  A recording says the unit of each of its signals; where nothing says
otherwise a signal is an angle.

>>> with_unit(0.0038, "rad"), with_unit(0.0038, "V"), with_unit(0.0038, "1")
('0.218°', '0.0038 V', '0.0038')
"""

from __future__ import annotations

import math

__all__ = ["GREEK", "SHOWN_UNITS", "shown_unit", "with_unit"]

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
"""The letter of an angle or an order that is called by its name."""

SHOWN_UNITS = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
"""Unit of a signal: how it is shown, and the factor to it; what is not here is shown as it is."""


def shown_unit(unit: str) -> tuple[str, float]:
    """In which unit values of that unit are shown, "" for a pure number, and the factor to it.

    Examples
    --------
    >>> shown_unit("V"), shown_unit("1")
    (('V', 1.0), ('', 1.0))
    """
    return SHOWN_UNITS.get(unit, ("" if unit == "1" else unit, 1.0))


def with_unit(value: float, unit: str = "rad", form: str = ".3g") -> str:
    """Write a value with the unit in which it is shown.

    Parameters
    ----------
    value : float
        [unit]
    unit : str
        SI, as of a recording's signal.
    form : str
        Python's format of the number.

    Examples
    --------
    >>> with_unit(0.5, "rad/s", ".1f"), with_unit(-2.0, "m")
    ('28.6°/s', '-2 m')
    """
    display_unit, factor = shown_unit(unit)
    return f"{factor * value:{form}}{display_unit if display_unit.startswith('°') else f' {display_unit}'.rstrip()}"
