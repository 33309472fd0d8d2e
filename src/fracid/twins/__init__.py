"""Simulated recordings with known truth, and the two that fracid ships."""
