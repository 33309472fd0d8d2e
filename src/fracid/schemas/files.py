"""Which description each file has, and its JSON Schema."""

from __future__ import annotations

import json

from pydantic.json_schema import GenerateJsonSchema

from fracid.errors import unknown_name
from fracid.safety.schema import Block
from fracid.schemas.comparison import ComparisonBlock
from fracid.schemas.draws import PosteriorBlock
from fracid.schemas.profiles import LikelihoodBlock
from fracid.schemas.regression import RegressionResultBlock
from fracid.schemas.residuals import ResidualsBlock
from fracid.schemas.result import ResultBlock
from fracid.schemas.study import StudyBlock

FILES: dict[str, type[Block]] = {
    "result.json": ResultBlock,
    "residuals.json": ResidualsBlock,
    "profiles.json": LikelihoodBlock,
    "regression.json": RegressionResultBlock,
    "compare.json": ComparisonBlock,
    "noise.json": StudyBlock,
    "posterior.json": PosteriorBlock,
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
    if file not in FILES:
        raise unknown_name("file", file, FILES)
    schema = FILES[file].model_json_schema(schema_generator=WithoutTitles)
    head = {"$schema": WithoutTitles.schema_dialect, "title": f"{file} of fracid"}
    return json.dumps(schema | head, indent=2, ensure_ascii=False) + "\n"
