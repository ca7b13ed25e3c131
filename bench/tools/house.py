"""The shape of the code, measured: `python -m bench.house [--root DIR] [--times] [--markdown]`.

The table has each measure at commit 1f1805b, now, and as asked; `--list NAME` prints what one of
them counts. `--walk scene` (dt, state, observable, parameter, error) prints the functions that such
a thing passes, in order, as "file: function". `--root DIR` measures another tree, whose package is
DIR.
`--static` leaves out those measures for which the package runs; `--times` times it. How each is
counted:

lines, files : of all .py files of the package.
code : lines that are not blank, of a docstring, or of a comment alone.
imports, comments : lines of import statements, also in functions, and of comments alone, over code.
small files : up to 60 lines and no `__init__`; also without entries of a registry. An entry is a
    module that a registry names: an `__init__` below the package's own that has `from entry import
    Name as Name`, or that imports three or more modules of its folder by their names; or a module
    with a constant NAMES = (...) or {...} of which all elements, keys or values are modules of the
    package, three or more, by their full names or as files of its folder or of one just below it.
layers : of the contract of import-linter in pyproject.toml; modules in one layer have one height.
circles : strongly connected modules, of two or more, by the imports of modules (not of functions),
    with those under TYPE_CHECKING, as import-linter takes them.
parameter `scene` : functions, methods and lambdas that have it.
import Scene : files that import the name, or anything of the module that defines it.
read `dt` : files with an attribute `.dt` of a run, a plan or whatever is not in DT_OF_OTHERS.
public names : functions of modules, without an underscore in front. A name is shared if two modules
    define it, and in two meanings unless these are all entries of one registry, or files of one
    name (`table` in each study.py).
class names : of module level, in two modules.
caches of a scene : functions under `@once`; WeakKeyDictionary of scenes, or without a type; `cache`
    and `lru_cache` of functions with a parameter in CACHED_OF_SCENE; `cached_property` of Scene;
    `scene.__dict__`, but where `once` is defined; ContextVar, but those in CONTEXT_OF_OTHERS.
parameters : all of them, with `self`, `*args` and `**named`.
participles : public names of which the last word, or the last before particles (asked_of), ends in
    -ed or is in IRREGULAR, or the only word ends in -ing; without NOUNS, and without names that
    begin with a word in VERBS (is_turned, check_saved). IRREGULAR has no word that is its own verb,
    such as "put".
name one study : files of package, docs and tests, and CHANGELOG.md, with the word STUDY in them.
reading list : the files that one reads to know what a kernel is, of the lists in READING the one of
    which this tree has most. A file that moved is found by its name; "5 of 7" says what is missing.
path of a scene : functions of modules, not methods or lambdas, that a warm `simulate` of 32 members
    of PATH_SCENE enters in the thread of its caller: their files, their names, and the climbs. A
    climb is a pair of files, entered one after the other, of which the second is in a higher layer;
    a pair counts once. "All functions" has methods and lambdas too, "given a Scene" the ones
    with an argument that is a Scene or a tuple, list or dict with one: files, climbs, functions.
error : files that an error of `run.dt` in a scene file passes from where it is raised to the
    screen: they raise it, pass or catch it, or have a function that is called with it.
simulate : median milliseconds of 32 members of LOOP_SCENES over 10 steps, interleaved and compiled
    before. Each call gets a copy of the scene, on which nothing is kept yet. The time around the
    kernel is twice that of 10 steps less that of 20, in each round.

The first column has the figures of the plan to rebuild the package, which were counted at 1f1805b;
this script counts there 19 files that read `dt`, 170 participles, 220 names on the path, and 3,655
lines of the reading list, else the same. In rows that begin with "..." both columns are its own,
but for the loop over one scene and the new scene. The plan took all shared names, 139, for names in
two meanings.
"""

import argparse
import statistics
from pathlib import Path
from typing import NamedTuple

from bench.tools import house_counts as counts
from bench.tools import house_imports as imports
from bench.tools import house_walks as walks
from bench.tools.house_counts import Sources
from bench.tools.house_walks import Visit

REPOSITORY = Path(__file__).parents[2]
PACKAGE = "rigidmc"

# {name for --list: what makes the list}
LISTS = {
    "small": imports.plain_small_files,
    "long": counts.long_files,
    "circles": imports.find_circles,
    "scene": counts.functions_of_scene,
    "imports": imports.importers_of_scene,
    "dt": counts.readers_of_dt,
    "names": imports.different_names,
    "classes": counts.shared_classes,
    "participles": counts.participles,
    "caches": counts.scene_caches,
    "parameters": counts.functions_of_many,
    "functions": counts.long_functions,
}


class Row(NamedTuple):
    """A measure: at 1f1805b, now, and as asked."""

    what: str
    before: str
    now: str
    asked: str


def static_rows(root: Path, sources: Sources) -> list[Row]:
    """The measures that need no run."""
    total, sizes = counts.count_lines(sources), [len(one.lines) for one in sources]
    found = {name: len(make(sources)) for name, make in LISTS.items()}
    layers = len(imports.read_layers(root.parent / "pyproject.toml", root.name))
    public, shared = len(counts.public_functions(sources)), len(counts.shared_names(sources))
    files = f"{len(sources)} ({sum(not one.is_init for one in sources)})"
    shares = [f"{100.0 * part / total.code:.1f} %" for part in (total.imports, total.comments)]
    study = counts.files_of_study(root.parent, root.name, counts.STUDY)
    listed = counts.reading_list(sources)
    read = [len(one.lines) for one in listed if one is not None]
    reading = f"{len(read)}{f' of {len(listed)}' * (None in listed)}, {sum(read):,}"
    rows = [
        ("lines / code lines", "50,074 / 32,660", f"{total.lines:,} / {total.code:,}",
         "47,500 / 30,000"),
        ("files (without `__init__`)", "374 (348)", files, "290 (246)"),
        ("files up to 60 lines, no `__init__`", "64", len(counts.small_files(sources)), "-"),
        ("... and no entry of a registry", "37", found["small"], "14"),
        ("median lines of a file", "117", f"{statistics.median(sizes):g}", "170"),
        ("files over 400 lines", "2", found["long"], "-"),
        ("layers / circles between files", "13 / 1", f"{layers} / {found['circles']}", "9 / 0"),
        ("functions with a parameter `scene`", "278", found["scene"], "90"),
        ("files that import Scene", "96", found["imports"], "50"),
        ("files that read `dt`", "20", found["dt"], "8"),
        ("public names shared / all", "139 / 1,122", f"{shared} / {public:,}", "-"),
        ("... in two meanings", "127", found["names"], "20"),
        ("class names used twice", "24", found["classes"], "0"),
        ("public functions that are participles", "166", found["participles"], "15"),
        ("caches of a scene", "14", found["caches"], "0"),
        ("imports / comments, of code", "13.6 % / 1.1 %", " / ".join(shares), "11 % / 4 to 7 %"),
        ("functions with 10 parameters or more", "30", found["parameters"], "8"),
        ("functions longer than 90 lines", "3", found["functions"], "-"),
        (f"files that name one study ({counts.STUDY})", "13", len(study), "5"),
        ("reading list of a kernel: files, lines", "20, 3,650", reading, "7, 1,450"),
    ]  # fmt: skip
    return [Row(what, before, str(now), asked) for what, before, now, asked in rows]


def running_rows(root: Path) -> list[Row]:
    """The measures for which the package runs."""
    height = imports.heights(imports.read_layers(root.parent / "pyproject.toml", root.name))

    def text(visits: list[Visit], functions: int) -> str:
        climbs = len(walks.climbs(visits, height))
        return f"{len({one.file for one in visits})}, {climbs}, {functions}"

    every, path, given = (
        walks.walk_of_path(root, sees)
        for sees in (walks.is_any, walks.is_of_module, walks.sees_kinds(walks.SCENES))
    )
    names = len({one.function for one in path})
    functions = [len(walks.first_visits(visits)) for visits in (every, given)]
    error = len({one.file for one in walks.walk_of_error(root)})
    return [
        Row(
            "path of a scene: files, climbs, names", "69, 85, 218", text(path, names), "30, 25, 60"
        ),
        Row("... all functions", "75, 117, 403", text(every, functions[0]), "-"),
        Row("... given a Scene", "23, 21, 88", text(given, functions[1]), "-"),
        Row("files that an error passes", "8", str(error), "4"),
    ]


def timed_rows(root: Path) -> list[Row]:
    """Median milliseconds."""
    found = walks.measure_times(root)

    def text(*whats: str) -> str:
        times = [found.get(what) for what in whats]
        return " / ".join("-" if time is None else f"{time:.2f} ms" for time in times)

    new, same = ([f"{word} {name}" for name in walks.LOOP_SCENES] for word in ("new", "same"))
    return [
        Row("`simulate` of 32, nothing kept", "3 to 6 ms", text(*new), "2.5 ms"),
        Row("... in a loop over one scene", "0.75 ms", text(*same), "2.5 ms"),
        Row("`prepared.run` of 32", "-", text("prepared"), "0.6 ms"),
        Row("... of 4,096 with `values=`, around the kernel", "-", text("values"), "1 ms"),
        Row("... `simulate` of a new scene of 4,096, likewise", "5.5 ms", text("rows"), "-"),
    ]


def table(rows: list[Row], markdown: bool) -> str:
    """The rows as text."""
    lines = [("measure", "1f1805b", "now", "asked"), *rows]
    if markdown:
        text = [f"| {' | '.join(line)} |" for line in lines]
        return "\n".join([text[0], "| --- | ---: | ---: | ---: |", *text[1:]])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])])
        for line in lines
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.house", description="The shape of the code, measured."
    )
    parser.add_argument(
        "--root", type=Path, default=REPOSITORY / PACKAGE, metavar="DIR", help="the package"
    )
    parser.add_argument("--static", action="store_true", help="run nothing of the package")
    parser.add_argument("--times", action="store_true", help="time `simulate` and `prepared.run`")
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
    if options.times:
        rows += timed_rows(root)
    print(table(rows, options.markdown))


if __name__ == "__main__":
    main()
