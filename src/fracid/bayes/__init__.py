"""The posterior of a fit's free parameters, and the evidence of its model."""
