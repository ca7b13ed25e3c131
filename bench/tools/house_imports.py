"""Import graph of a package, for `bench.house`."""

import ast
import re
import tomllib
from pathlib import Path

from bench.tools.house_counts import SCENE, Source, Sources, names_of


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
