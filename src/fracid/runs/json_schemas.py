"""Which description each file has, and its JSON Schema: ``python -m fracid.runs.json_schemas [FILE]``."""

from __future__ import annotations

import json
import sys

from pydantic.json_schema import GenerateJsonSchema

from fracid.errors import InputError, entry_of
from fracid.estimation.likelihood_record import Likelihood
from fracid.regression.linear import RegressionResult
from fracid.runs.saved import SavedRun
from fracid.safety.json_files import json_document
from fracid.safety.schema import Block, Record, described
from fracid.schemas.draws import PosteriorBlock
from fracid.schemas.feedback import ControlRecord
from fracid.selection.comparison_records import Comparison
from fracid.validation.monte_carlo import NoiseStudy
from fracid.validation.residual_records import ResidualsBlock

FILES: dict[str, type[Block | Record]] = {
    "result.json": SavedRun,
    "residuals.json": ResidualsBlock,
    "profiles.json": Likelihood,
    "regression.json": RegressionResult,
    "compare.json": Comparison,
    "noise.json": NoiseStudy,
    "posterior.json": PosteriorBlock,
    "control.json": ControlRecord,
}
"""What a command leaves for other programs; regression.json is that of one regression."""


class WithoutTitles(GenerateJsonSchema):
    """A field's title would only be its name again."""

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002
        """Never."""
        return False


def json_schema(file: str = "result.json") -> str:
    """The JSON Schema of one of the files, as text.

    Raises
    ------
    InputError
        If fracid writes no such file.

    Examples
    --------
    >>> json.loads(json_schema())["title"]
    'result.json of fracid'
    """
    schema = described(entry_of("file", FILES, file)).json_schema(schema_generator=WithoutTitles)
    head = {"$schema": WithoutTitles.schema_dialect, "title": f"{file} of fracid"}
    plain = json.loads(json.dumps(schema | head), parse_constant=lambda _: None)  # a default that is no number
    return json_document(plain)


if __name__ == "__main__":
    try:
        sys.stdout.write(json_schema(*sys.argv[1:2]))
    except InputError as error:
        sys.exit(f"error: {error}")
