"""Import graph of a package, and the entries of its registries, for `bench.house`."""

import ast
import re
import tomllib
from pathlib import Path
from typing import Any

from bench.tools.house_counts import (
    SCENE,
    Source,
    Sources,
    names_of,
    public_functions,
    shared_names,
    small_files,
)


def read_layers(pyproject: Path, package: str) -> list[list[str]]:
    """Return the layers of a package from the highest to the lowest, each as its modules."""
    if not pyproject.is_file():
        return []
    contracts = tomllib.loads(pyproject.read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next((one["layers"] for one in contracts if one.get("containers") == [package]), [])
    return [re.findall(r"[\w.]+", layer) for layer in layers]


def heights(layers: list[list[str]]) -> dict[str, int]:
    """Return {module or package below the root: height of its layer, 1 for the lowest}."""
    return {name: len(layers) - i for i, layer in enumerate(layers) for name in layer}


def imported_modules(source: Source, modules: set[str]) -> set[str]:
    """Return modules of the package that a module imports at import, or for its types."""
    found: set[str] = set()
    waiting: list[ast.AST] = [*source.tree.body]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = absolute(node, source)
            found |= {
                name if (name := f"{base}.{one.name}") in modules else base for one in node.names
            }
        waiting += ast.iter_child_nodes(node)
    return (found & modules) - {source.module}


def absolute(node: ast.ImportFrom, source: Source) -> str:
    """Return the module of `from module import ...`, also if it is relative."""
    if not node.level:
        return node.module or ""
    words = source.package.split(".")
    return ".".join([*words[: len(words) + 1 - node.level], *filter(None, [node.module])])


def packages_run(module: str, imported: set[str]) -> set[str]:
    """Return the packages whose `__init__` runs before these modules, except the importer's."""
    words = [name.split(".") for name in imported]
    found = {".".join(some[:i]) for some in words for i in range(1, len(some))}
    return {name for name in found if not f"{module}.".startswith(f"{name}.")}


def find_circles(sources: Sources, packages: bool = False) -> list[str]:
    """Find modules that import each other, "a b c"; by Tarjan, SIAM J. Comput. 1 (1972) 146.

    packages : whether an import also counts as an import of the packages that Python runs first
    """
    modules = {one.module for one in sources}
    edges = {one.module: imported_modules(one, modules) for one in sources}
    if packages:
        edges = {name: known | packages_run(name, known) for name, known in edges.items()}
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circles = []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in edges[name]:
            if other not in order:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == order[name]:
            circle = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(circle) > 1:
                circles.append(" ".join(sorted(circle)))

    for name in edges:
        if name not in order:
            visit(name)
    return circles


def importers_of_scene(sources: Sources) -> list[str]:
    """Return files that import Scene, or anything from the module that defines it."""
    home = {one.module for one in sources if SCENE in names_of(one, ast.ClassDef)}
    return [
        str(one.path)
        for one in sources
        if any(
            isinstance(node, ast.ImportFrom)
            and (absolute(node, one) in home or any(name.name == SCENE for name in node.names))
            for node in one.nodes
        )
    ]


def registry_entries(sources: Sources) -> dict[str, str]:
    """Return {module: the registry that names it}; the package's own `__init__` does not count."""
    modules = {one.module for one in sources}
    entries: dict[str, str] = {}
    for source in (one for one in sources if "." in one.module):
        for node in source.tree.body:
            if isinstance(node, ast.ImportFrom) and source.is_init:
                found = set(imported_entries(node, source, modules))
            elif isinstance(node, (ast.Assign, ast.AnnAssign)):
                found = set(named_entries(node, source, modules))
            else:
                continue
            entries |= dict.fromkeys(found - {source.module}, source.module)
    return entries


def imported_entries(node: ast.ImportFrom, source: Source, modules: set[str]) -> list[str]:
    """Return modules that an import of an `__init__` names as entries."""
    known = node.module or ""
    if known in modules and any(name.name == name.asname for name in node.names):
        return [known] * known.startswith(source.module + ".")
    own = [f"{known}.{name.name}" for name in node.names] if known == source.module else []
    own = [name for name in own if name in modules]
    return own if len(own) >= 3 else []


def named_entries(node: ast.Assign | ast.AnnAssign, source: Source, modules: set[str]) -> list[str]:
    """Return modules that a constant, NAMES = (...), names as entries."""
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    if not (isinstance(target, ast.Name) and target.id.isupper()):
        return []
    value = node.value
    sides: list[list[Any]] = []
    if isinstance(value, ast.Dict):
        sides = [value.keys, value.values]
    elif isinstance(value, (ast.Tuple, ast.List, ast.Set)):
        sides = [value.elts]
    below = {name.rpartition(".")[0] for name in modules if name.startswith(source.package + ".")}
    near = [name for name in below if name.count(".") <= source.package.count(".") + 1]
    for side in sides:
        words = [one.value for one in side if isinstance(one, ast.Constant)]
        words = [word for word in words if isinstance(word, str)]
        if not words or len(words) < len(side):
            continue
        for folder in ("", *near):
            found = {f"{folder}.{word}" if folder else word for word in words}
            if len(found) >= 3 and found <= modules:
                return sorted(found)
    return []


def plain_small_files(sources: Sources) -> list[str]:
    """Return small files that are not entries of a registry."""
    entries = registry_entries(sources)
    known = {str(one.path) for one in sources if one.module in entries}
    return [path for path in small_files(sources) if path not in known]


def different_names(sources: Sources) -> list[str]:
    """Return shared names with several meanings: neither of one registry, nor of files of one
    name."""
    entries, public = registry_entries(sources), public_functions(sources)
    found = []
    for name in shared_names(sources):
        registries = {entries.get(one.module, one.module) for one in public[name]}
        stems = {one.module if one.is_init else one.path.stem for one in public[name]}
        if len(registries) > 1 and len(stems) > 1:
            found.append(name)
    return found
