"""Certificates against the schema that the package has of them."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from jsonschema import Draft202012Validator


@cache
def _validator() -> Draft202012Validator:
    schema = json.loads(files("etude.limits").joinpath("certificate.schema.json").read_bytes())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def valid(data: bytes | str) -> dict[str, Any]:
    """What the file says. ValidationError: it is none of the schema; ValueError: no JSON, such as NaN."""
    content: dict[str, Any] = json.loads(data, parse_constant=_refuse)
    _validator().validate(content)
    return content


def _refuse(word: str) -> None:
    raise ValueError(f"{word} is no JSON")
