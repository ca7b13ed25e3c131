"""Type checkers and editors see the names that the package has."""

import ast

import rigidmc as rm
from bench.tools import stub


def test_the_stub_has_the_names_of_the_package():
    text = stub.FILE.read_text("utf-8")
    assert text == stub.stub(), "python -m bench.stub --write"
    imports = [one for one in ast.parse(text).body if isinstance(one, ast.ImportFrom)]
    names = {alias.asname for one in imports for alias in one.names} - {None}
    assert names | {"open"} == {*rm.__all__, "protocols"}
