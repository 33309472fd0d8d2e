"""Validation: is it right?  Checks before and after the search, of the residuals, of the sensors, by simulation."""
