"""run.json: what of a run never changes, and how many members the run has.

A run of chosen members has the hash of their indices in `chosen`, and in `growing` the level of the
last ones while what they say may ask for more, else 0.
"""

import hashlib
import json
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigidmc.errors import FileError
from rigidmc.files.reading import json_of, text_of

FORMAT = 1
MOST = 10**7  # shards, each a file; their names have eight digits
Count = Annotated[int, Field(ge=0, le=2**53)]
_Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Facts(BaseModel):
    """The keys of run.json, which may have no others, with their types and ranges."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: int
    scene: _Hash
    columns: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")]
    code: dict[str, str]
    attributes: dict[str, str | int | float]
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    first: Count
    members: Annotated[int, Field(ge=1, le=2**53)]
    shard: Annotated[int, Field(ge=1, le=2**53)]
    block: Annotated[int, Field(ge=1, le=2**20)]
    versions: dict[str, str]
    machine: str
    chosen: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")] = ""
    growing: Count = 0


def read_facts(path: str) -> dict[str, Any]:
    """The facts of a run.json; FileError if it is damaged or of another format."""
    text = text_of(path, links=False)
    try:
        facts = json_of(text)
        if isinstance(facts, dict):
            facts.pop("check", None)
        _Facts.model_validate(facts)
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else "run.json"
        rule = f"is damaged: {first['msg'][0].lower()}{first['msg'][1:]}"
        raise FileError("", key, None, rule, file=path) from None
    except ValueError as error:
        raise FileError("", "run.json", None, f"is damaged: {error}", file=path) from None
    if rendered(facts) != text:
        rule = "is damaged, or was changed by hand: its checksum does not match"
        raise FileError("", "run.json", None, rule, file=path)
    if facts["format"] != FORMAT:
        rule = f"this version reads format {FORMAT}"
        raise FileError("", "format", facts["format"], rule, file=path)
    if facts["first"] + facts["members"] > 2**53 or facts["shard"] % facts["block"]:
        rule = "is damaged: a shard must be whole blocks, and members below 2^53"
        raise FileError("", "members", None, rule, file=path)
    if facts["members"] > MOST * facts["shard"]:
        rule = f"is damaged: a run has at most {MOST:,} shards"
        raise FileError("", "shard", facts["shard"], rule, file=path)
    return dict(facts)


def rendered(facts: dict[str, Any]) -> str:
    """The text of run.json, with its checksum."""
    check = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return json.dumps({**facts, "check": check}, indent=1) + "\n"
