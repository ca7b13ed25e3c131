"""Measures of the code of a package that need no run, by `ast` and `tokenize`, for `bench.house`.

`bench.house` defines how each is counted.
"""

import ast
import io
import tokenize
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

# Names of the package, which a move may change.
SCENE = "Scene"
SCENE_BASES = ("Parts",)  # base classes of Scene: an object of them is a scene too

LONG_FILE, LONG_FUNCTION, MANY_PARAMETERS = 400, 90, 10


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


IRREGULAR = _words("""
    begun bent booked broken built chosen done drawn driven fed felt found frozen given gone grown
    held hidden kept known laid left lost made met paid said seen sent shaken shown slept sought
    spent spoken spun stood struck swept taken thrown told torn understood woven worn written
""")
NOUNS = _words("""
    bed crossing ending feed hundred king need nothing opening red ring seed setting shed speed
    spring string thing
""")
VERBS = _words("""
    any are as can check count get has have is makes must needs open refuse show takes why with
""")
PARTICLES = _words("again alike along at by from in of off often on out to up with")


class Source(NamedTuple):
    """A file of the package: its path below the root, its module, lines, tree, and all nodes."""

    path: Path
    module: str
    lines: list[str]
    tree: ast.Module
    nodes: list[ast.AST]  # stored, because the measures share them: 2 of 4 s

    @property
    def is_init(self) -> bool:
        return self.path.name == "__init__.py"

    @property
    def package(self) -> str:
        """The package that contains the module; an `__init__` is its own package."""
        return self.module if self.is_init else self.module.rpartition(".")[0]


Functions = ast.FunctionDef | ast.AsyncFunctionDef
Sources = list[Source]


def read_sources(root: Path) -> Sources:
    """Read all files of a package."""
    sources = []
    for path in sorted(root.rglob("*.py")):
        text, below = path.read_text("utf-8"), path.relative_to(root)
        words = [root.name, *below.with_suffix("").parts]
        module = ".".join(words[:-1] if words[-1] == "__init__" else words)
        tree = ast.parse(text)
        sources.append(Source(below, module, text.splitlines(), tree, [*ast.walk(tree)]))
    return sources


def docstring_lines(source: Source) -> set[int]:
    """Return the line numbers of docstrings."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found: set[int] = set()
    for node in source.nodes:
        if isinstance(node, kinds) and ast.get_docstring(node, clean=False) is not None:
            found |= line_numbers(node.body[0])
    return found


def line_numbers(node: ast.stmt) -> set[int]:
    """Return the line numbers of a statement."""
    return set(range(node.lineno, (node.end_lineno or node.lineno) + 1))


def comment_lines(source: Source) -> set[int]:
    """Return the line numbers of lines that are only a comment."""
    if not any(line.lstrip().startswith("#") for line in source.lines):
        return set()  # tokens take 2 ms a file
    text = "\n".join(source.lines) + "\n"
    return {
        token.start[0]
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT and not token.line[: token.start[1]].strip()
    }


def import_lines(source: Source) -> set[int]:
    """Return the line numbers of imports."""
    kinds = (ast.Import, ast.ImportFrom)
    return set().union(*(line_numbers(n) for n in source.nodes if isinstance(n, kinds)), set())


class Lines(NamedTuple):
    """The number of lines, and how many of them are code, comments, imports."""

    lines: int
    code: int
    comments: int
    imports: int


def count_lines(sources: Sources) -> Lines:
    """Count the Lines of all files."""
    total = Lines(0, 0, 0, 0)
    for source in sources:
        docs, comments = docstring_lines(source), comment_lines(source)
        blank = {i for i, line in enumerate(source.lines, 1) if not line.strip()} - docs
        code = len(source.lines) - len(docs) - len(blank) - len(comments)
        found = len(source.lines), code, len(comments), len(import_lines(source))
        total = Lines(*map(sum, zip(total, found, strict=True)))
    return total


def long_files(sources: Sources) -> list[str]:
    """Return files over LONG_FILE lines."""
    return [str(one.path) for one in sources if len(one.lines) > LONG_FILE]


def names_of(source: Source, kind: Any) -> list[str]:
    """Return names of functions or classes at the level of a module."""
    return [node.name for node in source.tree.body if isinstance(node, kind)]


def owners(sources: Sources, kind: Any, private: bool = False) -> dict[str, list[Source]]:
    """Return {name of a function or class at module level: the files that define it}."""
    found: dict[str, list[Source]] = defaultdict(list)
    for source in sources:
        for name in dict.fromkeys(names_of(source, kind)):
            if private or not name.startswith("_"):
                found[name].append(source)
    return found


def public_functions(sources: Sources) -> dict[str, list[Source]]:
    """Return {public function: the files that define it}."""
    return owners(sources, Functions)


def shared_names(sources: Sources) -> list[str]:
    """Return public functions that several modules define."""
    return [name for name, files in public_functions(sources).items() if len(files) > 1]


def shared_classes(sources: Sources) -> list[str]:
    """Return class names of module level that several modules define."""
    found = owners(sources, ast.ClassDef, private=True)
    return [name for name, files in found.items() if len(files) > 1]


def participles(sources: Sources) -> list[str]:
    """Return public functions whose names are participles."""
    return sorted(filter(is_participle, public_functions(sources)))


def is_past(word: str) -> bool:
    """Return whether a word is a past participle."""
    return (word.endswith("ed") or word in IRREGULAR) and word not in NOUNS


def is_participle(name: str) -> bool:
    """Return whether a function's name is a participle: settled, against_closed, asked_of."""
    words = name.split("_")
    if len(words) > 1 and words[0] in VERBS:
        return False
    if len(words) == 1 and name.endswith("ing") and name not in NOUNS:
        return True
    while len(words) > 1 and words[-1] in PARTICLES:
        words.pop()
    return is_past(words[-1])


def functions(source: Source) -> Iterator[Functions | ast.Lambda]:
    """Yield all functions, methods and lambdas of a file."""
    for node in source.nodes:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            yield node


def parameters(function: Functions | ast.Lambda) -> list[str]:
    """Return names of all parameters of a function."""
    given = function.args
    several = [one for one in (given.vararg, given.kwarg) if one is not None]
    return [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs, *several)]


def functions_with(sources: Sources, holds: Callable[[Any], bool]) -> list[str]:
    """Return functions, methods and lambdas with a property: "file:line name"."""
    return [
        f"{source.path}:{one.lineno} {getattr(one, 'name', 'lambda')}"
        for source in sources
        for one in functions(source)
        if holds(one)
    ]


def functions_of_scene(sources: Sources) -> list[str]:
    """Return functions with a parameter `scene`."""
    return functions_with(sources, lambda one: "scene" in parameters(one))


def functions_of_many(sources: Sources) -> list[str]:
    """Return functions with MANY_PARAMETERS or more."""
    return functions_with(sources, lambda one: len(parameters(one)) >= MANY_PARAMETERS)


def long_functions(sources: Sources) -> list[str]:
    """Return functions of more than LONG_FUNCTION lines, with their docstrings."""
    return functions_with(
        sources, lambda one: (one.end_lineno or 0) - one.lineno + 1 > LONG_FUNCTION
    )
