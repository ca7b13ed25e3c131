"""The names of the package for type checkers and editors: `python -m bench.stub [--write]`.

rigidmc loads its names when they are first used, some of them from registries, which type checkers
cannot follow. This writes them as imports into `rigidmc/__init__.pyi`, or reports differences.
"""

import argparse
import ast
import difflib
import sys
from collections import defaultdict
from pathlib import Path

import rigidmc as rm

FILE = Path(rm.__file__).with_suffix(".pyi")
HEAD = (
    '"""What `import rigidmc` has, for type checkers; `python -m bench.stub --write` makes it."""'
    "\n\n"
)


def order(name):
    """Sort as ruff sorts imports: constants, classes, then functions."""
    return 0 if name.isupper() else 1 if name[0].isupper() else 2, name


def stub():
    """Return the text of the stub."""
    homes = defaultdict(list)
    for name, home in {**rm._HOMES, **rm._registered()}.items():
        homes[f"rigidmc.{home}"].append(name)
    homes["rigidmc"].append("protocols")
    lines = ["from os import PathLike", "", "from xarray import Dataset", ""]
    for home in sorted(homes):
        names = sorted(homes[home], key=order)
        lines += [f"from {home} import {name} as {name}" for name in names]
    tree = ast.parse(Path(rm.__file__).read_text("utf-8"))
    (function,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "open")
    arguments, result = ast.unparse(function.args), ast.literal_eval(function.returns)
    arguments = arguments.replace("=False", " = ...")
    lines += ["", "__version__: str", "", f"def open({arguments}) -> {result}: ..."]
    return HEAD + "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.stub", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the file")
    write = parser.parse_args().write
    text, before = stub(), FILE.read_text("utf-8") if FILE.exists() else ""
    if write:
        FILE.write_text(text, "utf-8")
    elif text != before:
        sys.stdout.writelines(difflib.unified_diff(before.splitlines(True), text.splitlines(True)))
        sys.exit(1)


if __name__ == "__main__":
    main()
