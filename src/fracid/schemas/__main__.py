"""``python -m fracid.schemas [FILE]``: the JSON Schema of a file, of result.json as docs/result.schema.json has it."""

import sys

from fracid.errors import InputError
from fracid.schemas.files import json_schema

try:
    sys.stdout.write(json_schema(*sys.argv[1:2]))
except InputError as error:
    sys.exit(f"error: {error}")
