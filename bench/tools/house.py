"""The shape of the code, measured: `python -m bench.house [--root DIR] [--markdown]`.

`--list NAME` prints what a measure counts. `--walk scene` (dt, state, observable, parameter, error)
prints the functions that such a thing passes, in order, as "file: function". `--root DIR` measures
another tree, whose package is DIR. `--static` leaves out those measures for which the package runs.
How each is counted:

lines, files : of all .py files of the package.
code : lines that are not blank, of a docstring, or of a comment alone.
imports, comments : lines of import statements, also in functions, and of comments alone, over code.
layers : of the contract of import-linter in pyproject.toml; modules in one layer have one height.
circles : strongly connected modules, of two or more, by the imports of modules (not of functions),
    with those under TYPE_CHECKING, as import-linter takes them.
parameter `scene` : functions, methods and lambdas that have it.
import Scene : files that import the name, or anything of the module that defines it.
public names : functions of modules, without an underscore in front; shared if two modules define
    the name.
class names : of module level, in two modules.
parameters : all of them, with `self`, `*args` and `**named`.
participles : public names of which the last word, or the last before particles (asked_of), ends in
    -ed or is in IRREGULAR, or the only word ends in -ing; without NOUNS, and without names that
    begin with a word in VERBS (is_turned, check_saved). IRREGULAR has no word that is its own verb,
    such as "put".
path of a scene : functions of modules, not methods or lambdas, that a warm `simulate` of 32 members
    of PATH_SCENE enters in the thread of its caller: their files, their names, and the climbs. A
    climb is a pair of files, entered one after the other, of which the second is in a higher layer;
    a pair counts once.
error : files that an error of `run.dt` in a scene file passes from where it is raised to the
    screen: they raise it, pass or catch it, or have a function that is called with it.
"""

import argparse
import statistics
from pathlib import Path

from bench.tools import house_counts as counts
from bench.tools import house_imports as imports
from bench.tools import house_walks as walks
from bench.tools.house_counts import Sources

REPOSITORY = Path(__file__).parents[2]
PACKAGE = "rigidmc"

# {name for --list: what makes the list}
LISTS = {
    "long": counts.long_files,
    "circles": imports.find_circles,
    "scene": counts.functions_of_scene,
    "imports": imports.importers_of_scene,
    "names": counts.shared_names,
    "classes": counts.shared_classes,
    "participles": counts.participles,
    "parameters": counts.functions_of_many,
    "functions": counts.long_functions,
}


def static_rows(root: Path, sources: Sources) -> list[tuple[str, str]]:
    """Return (measure, figure) of what needs no run."""
    total, sizes = counts.count_lines(sources), [len(one.lines) for one in sources]
    found = {name: len(make(sources)) for name, make in LISTS.items()}
    layers = len(imports.read_layers(root.parent / "pyproject.toml", root.name))
    files = f"{len(sources)} ({sum(not one.is_init for one in sources)})"
    shares = [f"{100.0 * part / total.code:.1f} %" for part in (total.imports, total.comments)]
    return [
        ("lines / code lines", f"{total.lines:,} / {total.code:,}"),
        ("files (without `__init__`)", files),
        ("median lines of a file", f"{statistics.median(sizes):g}"),
        ("files over 400 lines", str(found["long"])),
        ("layers / circles between files", f"{layers} / {found['circles']}"),
        ("functions with a parameter `scene`", str(found["scene"])),
        ("files that import Scene", str(found["imports"])),
        (
            "public names shared / all",
            f"{found['names']} / {len(counts.public_functions(sources)):,}",
        ),
        ("class names used twice", str(found["classes"])),
        ("public functions that are participles", str(found["participles"])),
        ("imports / comments, of code", " / ".join(shares)),
        ("functions with 10 parameters or more", str(found["parameters"])),
        ("functions longer than 90 lines", str(found["functions"])),
    ]


def running_rows(root: Path) -> list[tuple[str, str]]:
    """Return (measure, figure) of what the package runs for."""
    height = imports.heights(imports.read_layers(root.parent / "pyproject.toml", root.name))
    path = walks.walk_of_path(root, walks.is_of_module)
    passed = [len({getattr(one, part) for one in path}) for part in ("file", "function")]
    climbs = len(walks.climbs(path, height))
    error = len({one.file for one in walks.walk_of_error(root)})
    return [
        ("path of a scene: files, climbs, names", f"{passed[0]}, {climbs}, {passed[1]}"),
        ("files that an error passes", str(error)),
    ]


def table(rows: list[tuple[str, str]], markdown: bool) -> str:
    """Return the rows as text."""
    if markdown:
        lines = [f"| {what} | {figure} |" for what, figure in [("measure", "figure"), *rows]]
        return "\n".join([lines[0], "| --- | ---: |", *lines[1:]])
    left, right = (max(map(len, column)) for column in zip(*rows, strict=True))
    return "\n".join(f"{what:{left}}  {figure:>{right}}" for what, figure in rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.house", description="The shape of the code, measured."
    )
    parser.add_argument(
        "--root", type=Path, default=REPOSITORY / PACKAGE, metavar="DIR", help="the package"
    )
    parser.add_argument("--static", action="store_true", help="run nothing of the package")
    parser.add_argument("--markdown", action="store_true", help="print a table for a page")
    parser.add_argument("--list", choices=LISTS, help="what a measure counts, one a line")
    parser.add_argument(
        "--walk", choices=walks.WALKS, help="the functions that it passes, in order"
    )
    options = parser.parse_args()
    root = options.root.resolve()
    if options.walk:
        visits = walks.walk(options.walk, root)
        for one in visits if options.walk == "error" else walks.first_visits(visits):
            print(f"{one.file}: {one.function}  ({one.note})")
        return
    sources = counts.read_sources(root)
    if options.list:
        print("\n".join(LISTS[options.list](sources)))
        return
    rows = static_rows(root, sources)
    if not options.static:
        rows += running_rows(root)
    print(table(rows, options.markdown))


if __name__ == "__main__":
    main()
