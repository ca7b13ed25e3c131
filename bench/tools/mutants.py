"""python -m bench.mutants [--count 200]: break the package and see whether the tests notice.

A mutant is the package with one sign, factor, index, frame, choice or row changed in dynamics,
effects, integrators, observables or the engine. The first judge is the hard cases in plain Python
(one lane, nothing compiled: seconds). Survivors go to the tests of those folders, also uncompiled,
and survivors of both go to compiled tests. Code that instructs the compiler (`COMPILED`) goes to
compiled tests only.
"""

import argparse
import ast
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
FOLDERS = ("physics/dynamics", "physics/effects", "physics/integrators", "physics/observables")
ENGINE = tuple(
    f"kernel/{name}.py"
    for name in ("member", "march", "monitoring", "growth", "events", "extrema", "block", "noise")
)  # runs uncompiled too
COMPILED = tuple(
    f"compiler/{name}.py"
    for name in ("vector_types", "intrinsics", "trees", "memory", "compose", "fma")
)
NO_PHYSICS = {  # decides what is compiled, and for whom: facts, tables and words
    "scheme", "sequence", "conserves", "accepts", "evaluations", "description", "refusal",
    "accepting", "scheme_of", "follows_turns", "method", "names", "exact_drift", "substep_count",
    "canonical", "name_of", "tree_size", "arguments", "depends_on_momentum", "innermost_cause",
    "__init__", "implements", "effect", "facts", "is_effect", "is_random", "is_conservative",
    "with_defaults", "interleaving", "old_word", "flag", "static_count",
}  # fmt: skip
# uncompiled
TESTS = (
    "tests/physics/dynamics",
    "tests/physics/effects",
    "tests/physics/observables/test_observables.py",
    "tests/physics/integrators/test_steps.py",
    "tests/engine/kernel/test_events.py",
)
COMPILED_TESTS = (
    "tests/engine/compiler/test_vector_types.py",
    "tests/engine/kernel/test_kernel.py",
    "tests/engine/kernel/test_noise.py",
    "tests/physics/observables",
    "tests/planning/test_member_steps.py",
    "tests/physics/effects/test_work.py",
    "tests/physics/effects/test_bath.py",
    "tests/engine/test_bits.py",  # last: it detects any changed digit, but not whether it is wrong
)
# compiled, long, or with numbers for which NumPy warns or plain Python rounds otherwise
LEFT_OUT = (
    "not ten_thousand_steps and not drifts_with_steps and not test_bath and not test_user"
    " and not frozen_members and not test_work and not keeps_the_momentum and not drift_is_relative"
    " and not orbit_whose_cube and not vectors_of_each and not [compiled]"
)
JUDGES = (  # quickest first: 40 s for all, uncompiled
    "toms903 step", "near middle axis 13", "damped asymmetric body", "flat disc",
    "equilibria stay, 1e5 steps", "at rest",
    "hairer free", "nasa brick", "sleeping top, 1e5 steps", "Staude's permanent rotation",
    "hairer heavy", "there and back", "oblate",
    "symmetric about 2", "I1 = I2 to 1e-12", "separatrix", "axis spins of a generic body",
    "backward steps and damping", "a torque on free motion",
    "to rest in 30 e-foldings",
)  # fmt: skip
PYTEST = (sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider")
SECONDS = 1200.0  # both judges take 80 s for a survivor; a longer run hangs


OPPOSITE = {ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="}
WORDS = {  # of LLVM
    "fadd": "fsub", "fsub": "fadd", "fmul": "fdiv", "add": "sub", "sub": "add", "mul": "add",
    "and_": "or_", "or_": "xor", "xor": "and_",
    "shl": "lshr", "lshr": "shl", "<": ">", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
    "fabs": "sqrt", "uno": "ord", "fneg": "fabs",
}  # fmt: skip


def places(engine=True, physics=True):
    """List every breakable place: (file, kind, line, column, end line, end column, new text)."""
    paths, all_places = [], []
    for folder in FOLDERS if physics else ():
        names = sorted(os.listdir(os.path.join(ROOT, "rigidmc", folder)))
        paths += [
            (folder, name)
            for name in names
            if name.endswith(".py") and name not in ("methods.py", "closed_form.py")
        ]
    paths += [("engine", name) for name in (*ENGINE, *COMPILED)] if engine else []
    for folder, name in paths:
        path = os.path.join("rigidmc", folder, name)
        with open(os.path.join(ROOT, path)) as file:
            text = file.read()
        all_places += [
            (path, *place) for place in _in_file(ast.parse(text), text, folder == "engine")
        ]
    return all_places


def is_compiled(path):
    """Return whether a file instructs the compiler."""
    return path in [os.path.join("rigidmc", "engine", name) for name in COMPILED]


def _in_file(tree, text, engine):
    """Return the places of a file: (kind, line, column, end line, end column, new text)."""
    all_places = []

    def source(node):
        return ast.get_source_segment(text, node)

    def visit(node, inside):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            if node.name not in NO_PHYSICS:
                for child in node.body:
                    visit(child, inside or isinstance(node, ast.FunctionDef))
            return
        if isinstance(node, ast.Assign) and not inside:
            # tables of coefficients; not facts of classes, not constants of float32
            name = getattr(node.targets[0], "id", "")
            if not name.isupper() or name == "SINGLE":
                return
            inside = True
        if inside:
            span = [getattr(node, name, None) for name in SPAN]
            all_places.extend((kind, *span, new) for kind, new in _broken(node, source, engine))
            parts = node.elts if isinstance(node, ast.Tuple) else ()
            if len(parts) > 1 and all(getattr(x, "value", None) == 0 for x in parts):
                return  # only its length counts
        for child in ast.iter_child_nodes(node):
            if not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)):
                visit(child, inside)

    for node in tree.body:
        is_text = isinstance(getattr(node, "value", None), ast.Constant)
        visit(node, engine and isinstance(node, (ast.For, ast.Expr)) and not is_text)
    return all_places


SPAN = ("lineno", "col_offset", "end_lineno", "end_col_offset")


def _broken(node, source, engine):
    """Yield (kind, new text) for each way to break a node of a function."""
    value = getattr(node, "value", None) if isinstance(node, ast.Constant) else None
    if isinstance(node, ast.BinOp):
        left, right = source(node.left), source(node.right)
        if isinstance(node.op, (ast.Add, ast.Sub)) and not _of_tuples(node):
            yield "sign", f"({left} {'-' if isinstance(node.op, ast.Add) else '+'} ({right}))"
        if isinstance(node.op, (ast.BitAnd, ast.BitOr)):
            yield (
                "choice",
                f"(({left}) {'|' if isinstance(node.op, ast.BitAnd) else '&'} ({right}))",
            )
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        if not isinstance(node.operand, ast.Constant):
            yield "sign", f"({source(node.operand)})"
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        if node.slice.value in (0, 1, 2):
            yield "index", f"{source(node.value)}[{(node.slice.value + 1) % 3}]"
    elif isinstance(node, ast.Compare):
        if engine and type(node.ops[0]) in OPPOSITE and not _of_length(node):
            opposite = OPPOSITE[type(node.ops[0])]
            yield "choice", f"({source(node.left)} {opposite} {source(node.comparators[0])})"
    elif type(value) is float and value != 0.0:
        yield "factor", f"({source(node)} * 1.01)"
    elif engine and type(value) is int:
        yield "row", str(value + 1)
    elif engine and value in WORDS:
        yield "choice", repr(WORDS[value])
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        name, args = node.func.id, [source(a) for a in node.args]
        if name == "select":
            yield "choice", f"select({args[0]}, {args[2]}, {args[1]})"
        if name in ("multiply", "cross") and len(args) == 2:
            yield "frame", f"{name}({args[1]}, {args[0]})"
        if name == "conjugate" and len(args) == 1:
            yield "frame", args[0]
        if name == "vertical" and len(args) == 1:
            yield "frame", "vertical(({0}[0], -{0}[1], -{0}[2], -{0}[3]))".format(args[0])


def _of_tuples(node):
    """Return whether a sum joins tuples, judged from the source; their difference is an error."""
    both = node.left, node.right
    return any(
        isinstance(x, ast.Tuple) or (isinstance(x, ast.BinOp) and _of_tuples(x)) for x in both
    ) or [getattr(x, "id", "") for x in both] == ["q", "l"]


def _of_length(node):
    """Return whether a comparison ends a recursion over a tuple, which otherwise never ends."""
    return isinstance(node.left, ast.Call) and getattr(node.left.func, "id", "") == "len"


def chosen(count, seed, every):
    """Return `count` of the places, each kind in proportion."""
    some = random.Random(seed)
    kinds: dict[str, list] = {}
    for place in every:
        kinds.setdefault(place[1], []).append(place)
    shares = {"sign": 0.25, "factor": 0.15, "index": 0.2, "frame": 0.05, "choice": 0.2, "row": 0.15}
    mutants = []
    for kind, share in shares.items():
        mutants += some.sample(
            kinds.get(kind, []), min(len(kinds.get(kind, [])), round(share * count))
        )
    return mutants


def found_again(row):
    """Return the present place of a mutant, even if its line moved; LookupError if it is gone."""
    with open(os.path.join(ROOT, row["file"])) as file:
        lines = file.read().split("\n")
    at = [i + 1 for i, line in enumerate(lines) if line.strip() == row["before"]]
    if not at:
        raise LookupError(f"{row['file']}: no line {row['before']!r}; judge all mutants again")
    line = min(at, key=lambda i: abs(i - row["line"]))
    old = lines[line - 1]
    column = len(old) - len(old.lstrip())
    return row["file"], row["kind"], line, column, line, len(old), row["after"]


def broken(place, folder):
    """Copy the package with one place broken; return the line before and after."""
    path, _, line, column, end_line, end_column, new = place or (None,) * 7
    shutil.copytree(
        os.path.join(ROOT, "rigidmc"),
        os.path.join(folder, "rigidmc"),
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    for name in ("tests", "bench", "docs", "pyproject.toml"):  # tests read tables of pages
        os.symlink(os.path.join(ROOT, name), os.path.join(folder, name))
    if place is None:
        return "", ""
    with open(os.path.join(ROOT, path), "rb") as file:
        lines = file.read().split(b"\n")
    before = lines[line - 1].decode().strip()
    last = lines[end_line - 1][end_column:]
    lines[line - 1 : end_line] = [lines[line - 1][:column] + new.replace("\n", " ").encode() + last]
    with open(os.path.join(folder, path), "wb") as file:
        file.write(b"\n".join(lines))
    return before, lines[line - 1].decode().strip()


def judged(place):
    """Judge one mutant, or the unchanged package if place is None: {"killed": by which, ...}."""
    with tempfile.TemporaryDirectory(prefix="rigidmc-mutant-") as folder:
        before, after = broken(place, folder)
        row = {}
        if place is not None:
            row = dict(zip(("file", "kind", "line"), place, strict=False))
            row |= {"before": before, "after": after}
        cache = os.path.join(folder, "cache")
        env = {**os.environ, "PYTHONPATH": folder, "RIGIDMC_CACHE_DIR": cache}
        began = time.perf_counter()
        plain, killed = {**env, "NUMBA_DISABLE_JIT": "1"}, None
        if place is None or not is_compiled(place[0]):
            code, message = _run(
                [sys.executable, "-c", "from bench.tools.mutants import judge; judge()"],
                folder,
                plain,
                SECONDS,
            )
            killed = None if code == 0 else f"hard cases: {message}"
            if killed is None:
                code, message = _run([*PYTEST, "-k", LEFT_OUT, *TESTS], folder, plain, SECONDS)
                killed = None if code == 0 else f"tests: {message}"
        if killed is None:
            code, message = _run([*PYTEST, *COMPILED_TESTS], folder, env, SECONDS)
            killed = None if code == 0 else f"compiled tests: {message}"
        return {**row, "killed": killed, "seconds": time.perf_counter() - began}


def _run(words, folder, env, seconds):
    try:
        done = subprocess.run(
            words, cwd=folder, env=env, capture_output=True, text=True, timeout=seconds
        )
    except subprocess.TimeoutExpired:
        return 1, f"longer than {seconds:g} s"
    lines = (
        [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR", "above"))]
        or done.stderr.splitlines()[-1:]
        or [""]
    )
    return done.returncode, lines[0][:200]


def judge():
    """Run hard cases in plain Python until one exceeds its bound; then exit with 1."""
    from rigidmc.engine.kernel import layout

    layout.LANES = 1
    from rigidmc.studies.stress import catalogue
    from rigidmc.studies.stress import hard_cases as run
    from rigidmc.studies.stress.processes import run_case

    known = run.shipped_bounds()
    cases = sorted(
        (case for case in catalogue() if case.name in JUDGES),
        key=lambda case: JUDGES.index(case.name),
    )
    for case in cases:
        for name in case.integrators():
            error, _, reason = run_case(case, name, 1e-4)
            bound = run.bound_of(case, name, known)[0]
            # plain Python has no fused multiply-adds: it rounds differently, at most 0.54 of the
            # shipped bounds here
            if reason or error > bound:
                print(f"above: {case.name}, {name}: {error:.1e} > {bound:.1e} {reason}")
                sys.exit(1)


def main():
    parser = argparse.ArgumentParser(
        prog="python -m bench.mutants", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--count", type=int, default=200, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1, help="seed of the choice")
    parser.add_argument(
        "--of", choices=("all", "physics", "engine"), default="all", help="packages to break"
    )
    parser.add_argument(
        "--threads", type=int, default=os.cpu_count() or 1, help="mutants judged at once"
    )
    parser.add_argument(
        "--output", default=os.path.join(ROOT, "bench", "results", "mutants.json"), metavar="FILE"
    )
    parser.add_argument(
        "--again", action="store_true", help="judge the survivors of FILE again, with new tests"
    )
    options = parser.parse_args()
    rows, mutants = [], []
    every = places(options.of != "physics", options.of != "engine")
    if options.again:
        with open(options.output) as file:
            for row in json.load(file):
                (rows if row["killed"] else mutants).append(row)
        mutants = [found_again(row) for row in mutants]
    else:
        mutants = chosen(options.count, options.seed, every)
    if message := judged(None)["killed"]:
        sys.exit(f"the unchanged package does not pass: {message}")
    with ThreadPoolExecutor(options.threads) as pool:
        for row in pool.map(judged, mutants):
            rows.append(row)
            word = "killed  " if row["killed"] else "SURVIVED"
            print(
                (
                    f"{len(rows):3d} {word} {row['kind']:6s} {row['file']}:{row['line']}  "
                    f"{row['after'][:90]}  <- {row['killed'] or row['before'][:90]}"
                ),
                flush=True,
            )
    alive = [row for row in rows if not row["killed"]]
    print(
        f"{len(rows) - len(alive)} of {len(rows)} killed, "
        f"{100.0 * (1.0 - len(alive) / len(rows)):.1f} %, of {len(every):,} places"
    )
    by_cases = sum(bool(row["killed"]) and row["killed"].startswith("hard cases") for row in rows)
    print(
        f"{by_cases} by the hard cases alone; "
        f"{math.fsum(row['seconds'] for row in rows):.0f} s of work"
    )
    with open(options.output, "w") as file:
        json.dump(rows, file, indent=1)
        file.write("\n")


if __name__ == "__main__":
    main()
