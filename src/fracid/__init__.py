"""fracid identifies fractional-order and integer-order models of nonlinear mechanical systems."""

__version__ = "0.1.0"
