"""What a preset of a project puts into its ``[fit]``: a new one is a row."""

from __future__ import annotations

from typing import Any

PRESETS: dict[str, dict[str, Any]] = {
    "paper": {
        "method": "gl-paper",
        "cost": "itae",
        "weights": "equal",
        "outputs": ["alpha"],
        "per_recording": [],
        "initial_state": "held",
        "substeps": 1,
        "optimiser": "genetic",
    }
}
"""By name; ``paper`` also fixes every parameter, at the rig's value where one is named, and frees the orders."""
