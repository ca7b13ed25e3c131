"""The facts of run.json, which define a run: their keys, ranges, text and checksum."""

import hashlib
import json
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigidmc.errors import FileError, in_file
from rigidmc.files.reading import json_of, text_of
from rigidmc.inputs.arrays import Ints
from rigidmc.scene.scene import Scene

FORMAT = 1
MOST = 10**7  # maximum number of shards, one file each; their names have eight digits
Count = Annotated[int, Field(ge=0, le=2**53)]
_Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Facts(BaseModel):
    """The only keys of run.json, with their types and ranges."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: int
    scene: _Hash
    columns: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")]
    code: dict[str, str]
    contents: dict[str, str] = {}
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
    """Read the facts of a run.json; FileError if it is damaged or of another format."""
    with in_file(path):
        return _facts_of(text_of(path, links=False))


def _facts_of(text: str) -> dict[str, Any]:
    try:
        facts = json_of(text)
        if isinstance(facts, dict):
            facts.pop("check", None)
        _Facts.model_validate(facts)
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else "run.json"
        rule = f"is damaged: {first['msg'][0].lower()}{first['msg'][1:]}"
        raise FileError(rule, at=key) from None
    except ValueError as error:
        raise FileError(f"is damaged: {error}", at="run.json") from None
    if facts_text(facts) != text:
        rule = "is damaged or edited: its checksum does not match"
        raise FileError(rule, at="run.json")
    if facts["format"] != FORMAT:
        rule = f"this version reads format {FORMAT}"
        raise FileError(rule, at="format", value=facts["format"])
    if facts["first"] + facts["members"] > 2**53 or facts["shard"] % facts["block"]:
        rule = "is damaged: shards must consist of whole blocks, and members be below 2^53"
        raise FileError(rule, at="members")
    if facts["members"] > MOST * facts["shard"]:
        rule = f"is damaged: a run has at most {MOST:,} shards"
        raise FileError(rule, at="shard", value=facts["shard"])
    return dict(facts)


def facts_text(facts: dict[str, Any]) -> str:
    """Return the text of run.json, with its checksum."""
    check = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return json.dumps({**facts, "check": check}, indent=1) + "\n"


def selection_facts(members: Ints) -> dict[str, Any]:
    """Return the facts of chosen members for run.json; members.i64 has their indices, eight bytes
    each."""
    data = members.astype("<i8").tobytes()
    return {"members": members.size, "chosen": hashlib.sha256(data).hexdigest()}


def hash_of(scene: Scene) -> str:
    """Return the hash of all that determines a member: the scene without its member range."""
    return hashlib.sha256(scene.with_run(members=1, first=0).dumps().encode()).hexdigest()
