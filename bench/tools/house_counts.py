"""Measures of the code of a package that need no run, by `ast` and `tokenize`, for `bench.house`.

`bench.house` defines how each is counted.
"""

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

# Names of the package, which a move may change.
SCENE = "Scene"
SCENE_BASES = ("Parts",)  # base classes of Scene: an object of them is a scene too
# owners of a `dt` other than a run's: an object itself, rows of tables, candidates of a tolerance
DT_OF_OTHERS = {"self", "row", "w", "way", "candidate", "choice"}
CACHED_OF_SCENE = {"scene", "dimensions"}  # dimensions: of its random numbers
CONTEXT_OF_OTHERS = {"announced", "end"}  # of shown progress; of the time limit for work
STUDY = "ftle"
READING = {  # {tree: files to read there to understand a kernel}
    "1f1805b": """
        engine/__init__ engine/program engine/compose engine/pieces engine/frame engine/cpu
        engine/march engine/member engine/layout engine/kinds engine/memory engine/numbers
        engine/intrinsics engine/pipeline engine/lean engine/fused
        integrators/rk4 integrators/protocol integrators/form dynamics/methods""",
    "asked": """
        engine/__init__ physics/integrators/rk4 engine/kernel/arguments engine/kernel/layout
        engine/kernel/member engine/kernel/march engine/kernel/block""",
}

SMALL, LONG_FILE, LONG_FUNCTION, MANY_PARAMETERS = 60, 400, 90, 10


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
    nodes: list[ast.AST]  # stored, because twelve measures use them: 2 of 4 s

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


# ---- lines


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


# ---- files and names


def small_files(sources: Sources) -> list[str]:
    """Return files up to SMALL lines, without `__init__`."""
    return [str(one.path) for one in sources if len(one.lines) <= SMALL and not one.is_init]


def long_files(sources: Sources) -> list[str]:
    """Return files over LONG_FILE lines."""
    return [str(one.path) for one in sources if len(one.lines) > LONG_FILE]


def files_of_study(repository: Path, package: str, study: str) -> list[str]:
    """Return files of a repository that name a study."""
    kinds = {".py", ".pyi", ".md", ".toml", ".csv", ".ipynb"}
    files = [repository / "CHANGELOG.md"]
    for folder in (package, "docs", "tests"):
        files += (path for path in (repository / folder).rglob("*") if path.suffix in kinds)
    return sorted(
        str(path.relative_to(repository))
        for path in files
        if path.is_file() and "_build" not in path.parts and study in path.read_text("utf-8")
    )


def reading_list(sources: Sources) -> list[Source | None]:
    """Return the files that explain a kernel, from the list that fits this tree best; None for each
    missing one."""
    lists = [[find_file(name, sources) for name in names.split()] for names in READING.values()]
    return max(lists, key=lambda files: sum(one is not None for one in files) / len(files))


def find_file(name: str, sources: Sources) -> Source | None:
    """Find a file by its path, by the end of its path if it moved, or by name in its package."""
    paths = {one.path.with_suffix("").as_posix(): one for one in sources}
    room, _, stem = name.partition("/")
    ways = (
        lambda path: path == name,
        lambda path: path.endswith(f"/{name}"),
        lambda path: path.startswith(f"{room}/") and path.endswith(f"/{stem}"),
    )
    found = (one for fits in ways for path, one in paths.items() if fits(path))
    return next(found, None)


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


def readers_of_dt(sources: Sources) -> list[str]:
    """Return files that read the step of a run."""

    def reads(node: ast.AST) -> bool:
        if not (isinstance(node, ast.Attribute) and node.attr == "dt"):
            return False
        return isinstance(node.ctx, ast.Load) and last_name(node.value) not in DT_OF_OTHERS

    return [str(one.path) for one in sources if any(map(reads, one.nodes))]


def last_name(node: ast.AST) -> str:
    """Return the last word of a dotted name, call or item: `costs` of `self.costs(x)[0]`."""
    while isinstance(node, (ast.Call, ast.Subscript)):
        node = node.func if isinstance(node, ast.Call) else node.value
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def scene_caches(sources: Sources) -> list[str]:
    """Return places that store something on a scene, or for a scene: "file: cache"."""
    found = []
    for source in sources:
        home = "once" in names_of(source, Functions)
        for node in source.nodes:
            found += [f"{source.path}: {what}" for what in caches_of(node, home)]
    return found


def caches_of(node: ast.AST, home: bool) -> Iterator[str]:
    """Yield the scene caches that one node creates; home : whether its file defines `once`."""
    if isinstance(node, Functions):
        for decorator in map(last_name, node.decorator_list):
            if decorator == "once":
                yield f"@once {node.name}"
            if decorator in ("cache", "lru_cache") and {*parameters(node)} & CACHED_OF_SCENE:
                yield f"@{decorator} {node.name}"
    elif isinstance(node, ast.ClassDef) and node.name in (SCENE, *SCENE_BASES):
        for method in (one for one in node.body if isinstance(one, Functions)):
            if "cached_property" in map(last_name, method.decorator_list):
                yield f"@cached_property {method.name}"
    elif isinstance(node, (ast.Assign, ast.AnnAssign)) and isinstance(node.value, ast.Call):
        made = last_name(node.value)
        text = ast.unparse(node)  # with the type: WeakKeyDictionary[Scene, ...]
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        name = ast.unparse(target)
        if made == "WeakKeyDictionary" and ("[" not in text or f"[{SCENE}" in text):
            yield f"WeakKeyDictionary {name}"
        if made == "ContextVar" and not CONTEXT_OF_OTHERS & {*re.findall(r"[a-z]+", text)}:
            yield f"ContextVar {name}"
    elif not home and isinstance(node, ast.Attribute) and node.attr == "__dict__":
        yield from ["scene.__dict__"] * (last_name(node.value) == "scene")
