"""The solver: fractional differential equations, stepped by compiled loops with compressed memory."""
