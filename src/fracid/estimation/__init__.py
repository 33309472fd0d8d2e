"""Estimation: the search for the minimum, and how well the data determine what it found."""
