"""What a preset of a project puts into its ``[fit]``: a new one is a table of ``presets.toml``."""

from __future__ import annotations

import tomllib
from typing import Any

from fracid.safety.door import own_text

PRESETS: dict[str, dict[str, Any]] = tomllib.loads(own_text("problem/presets.toml"))
"""By name."""
