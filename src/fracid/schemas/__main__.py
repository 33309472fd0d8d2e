"""``python -m fracid.schemas``: the JSON Schema of result.json, as docs/result.schema.json has it."""

import sys

from fracid.schemas.result import json_schema

sys.stdout.write(json_schema())
