"""List numbers of the documentation without a source: `python -m bench.claims [--all]`.

A number in README.md, docs, docstrings, help texts and shipped scenes that states what rigidmc does
is drawn from a bench, printed by the page when it is built, or given next to its source. This
script lists the others: page, line, number, and the words around it. Its rules:

Not counted are code, commands, formulas, quoted text, links and citations; tables between bench
marks, and the first column of others; headings, dates and versions; parameters, that is numbers in
code of the same page, in the scenes that this code loads, and constants of a docstring's own module
or that it imports by name; names ("axis 3", "order 8", "section 11", "float64"); examples of input
("e.g. 0.3"); whole numbers to 12, 0.0 and 1.0, levels of confidence, full and right angles, powers
of ten, and g. A default ("by default 16") must be a constant of the package.

A number has a source if its paragraph, or its table and the paragraph before that, names a command
(`rigidmc ...`, `python -m bench ...`) or the publication that it is from ({cite}, "et al.", a year
in brackets), or if the paragraph leads to a cell that is executed when the page is built. A test
(`tests/...`) is a source if it has the number, or reads the page; the test of a docstring may be
named anywhere in it. The "Source:" of a docstring is for a method, not for a number.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
NUMBER = re.compile(
    r"(?<![\w.,/^_\-])[-\u2212]?\d{1,3}(?:(?:,\d{3})+|\d*)(?:\.\d+)?(?:e[-+]?\d+)?"
    r"(?![\w/]|\.\d|-\w)",
    re.IGNORECASE,
)
GIVEN = re.compile(
    r"`rigidmc [^`]+`|python -m bench|`python -[^`]+`|\{cite|et al|\((?:1[6-9]|20)\d\d\)"
    r"|TdC|DLMF|IEEE 754|ISO|WGS|arXiv"
)
SOURCE = re.compile(r"\bSources?:.*", re.S)  # of a method, at the end of a docstring
TEST = re.compile(r"tests/[\w/]+\.py")
LEADS = re.compile(r":\s*```\{(?:code-cell|output|picture)\}")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.S | re.M)
DROPPED = (
    re.compile(r"\A---\n.*?\n---\n", re.S),  # front matter
    re.compile(r"<!-- bench:(\w+) -->.*?<!-- /bench:\1 -->", re.S),
    FENCE,
    re.compile(r"\$\$.*?\$\$|\$[^$\n]+(?:\n[^$\n]+)?\$", re.S),
    re.compile(r"``[^`]+``|`[^`]*`"),
    re.compile(r"\{[\w:]+\}`[^`]*`|\]\([^)]*\)|<[^>\n]+>|\b\w+://\S+"),
    re.compile(r"^#+ .*$", re.M),
    re.compile(r"^\| *[\w.°%]+ *(?=\|)", re.M),  # the name of a row
    re.compile(r"::\n\n(?:[ \t]*\n|    +.*\n)+"),  # code and formulas of docstrings
    re.compile(r'"[^"\n]*"'),
    re.compile(r"\{ [^{}\n]* \}"),  # tables of a scene
)
NAMED = re.compile(
    r"(?:\b(?:axis|axes|order|section|example|figure|table|equation|degree|member|issue|level|IEEE"
    r"|exit code|capability|version|python|seed|chapter|appendix|check-case|case|float|int|utf|tm"
    r"|group|note|index)s?|§|\bp\.)\s*(?:\d[\d.]*(?:,? (?:and|to|or) )?)+"
    r"|\b\d{1,2} (?:January|February|March|April|May|June|July|August|September|October|November"
    r"|December)\b|\b\d[\d.]*-(?:bit|sigma|vector|dimensional|digit)\w*|\b\d+ bits?\b"
    r"|v?\d+\.\d+\.\d+"
    r"|\b\d+[, ]+\((?:1[6-9]|20)\d\d\),? \d+|TdC (?:\(\d\.\d+\)[-\u2013, and]*)+",  # of works
    re.IGNORECASE,
)
# levels, angles, powers of two and ten, and g
PLAIN = {
    0.0, 0.5, 1.0, 1.5, 9.81, 20, 24, 25, 32, 50, 60, 64, 68, 75, 90, 95, 99, 128, 180, 256, 270,
    360, 512, 1e-6,
}  # fmt: skip
# examples of input, not facts: "e.g. 0.3 or 0.4", "such as 1e6"
EXAMPLE = re.compile(
    rf"\b(?:e\.g\.|such as)\s+{NUMBER.pattern}(?:(?:,\s*|\s+or\s+|\s+and\s+){NUMBER.pattern})*",
    re.IGNORECASE,
)
DEFAULT = re.compile(r"\bby default(?:[^.;]|\.(?=\d))*", re.IGNORECASE)

SCENES = {
    path.stem: path.read_text("utf-8")
    for path in (ROOT / "rigidmc" / "scene" / "library").glob("*.toml")
}


class Claim(NamedTuple):
    """A number in a paragraph; given : its source, "" if none is named."""

    file: str
    line: int
    number: str
    words: str
    given: str


def blanked(text: str, pattern: re.Pattern[str]) -> str:
    """Replace each match by spaces, and keep the lines of the text."""
    return pattern.sub(lambda one: re.sub(r"[^\n]", " ", one[0]), text)


def value(number: str) -> float:
    """Return the value of a number as it is written, without its sign."""
    return abs(float(number.replace(",", "").replace("_", "").replace("\u2212", "-")))


def numbers(text: str, parameters: set[float]) -> Iterator[tuple[int, str]]:
    """Yield (offset, number) of possible claims in plain words."""
    for pattern in (NAMED, EXAMPLE):
        text = blanked(text, pattern)
    for one in NUMBER.finditer(text):
        size = value(one[0])
        if size in PLAIN or size in parameters:
            continue
        if size.is_integer() and (size <= 12 or 1600 <= size <= 2035):
            continue
        if re.fullmatch(r"10+", f"{size:.0f}"):  # a power of ten
            continue
        yield one.start(), one[0]


def parameters_of(code: str) -> set[float]:
    """Return the numbers in a page's code: values given there need no measurement."""
    found = re.findall(r"(?<![\w.])\d[\d_]*(?:\.\d+)?(?:e[-+]?\d+)?", code, re.I)
    return {value(word) for word in found} | {float(f"{value(word):g}") for word in found}


def shows(test: str, number: str) -> bool:
    """Return whether a test has a number, or one that rounds to it; for 95 % it may have 0.95."""
    digits, _, power = number.replace(",", "").lower().partition("e")
    places = int(power or 0) - len(digits.partition(".")[2])
    if places == 0:  # 54,000 is 53,960
        places = len(digits) - len(digits.rstrip("0"))
    half, size = 0.5000001 * 10.0**places, value(number)
    return any(abs(one - size) <= half for one in numbers_of(test))


@cache
def numbers_of(test: str) -> tuple[float, ...]:
    """Return the numbers of a test, and a hundred times each."""
    text = re.sub(r"(?<=\d)_(?=\d)", "", (ROOT / test).read_text("utf-8"))
    found = {value(one[0]) for one in NUMBER.finditer(text)}
    return *found, *(100.0 * one for one in found)


def given_by(file: str, words: str, number: str, tests: str = "") -> str:
    """Return the source of a number that a paragraph of a file names, "" if there is none."""
    if file.endswith(".py"):
        words = SOURCE.sub("", words)
    if found := GIVEN.search(words) or LEADS.search(words):
        return found[0]
    for test in TEST.findall(f"{words} {tests}"):
        if (ROOT / test).is_file():
            page = file.endswith(".md") and f'"{Path(file).name}"' in (ROOT / test).read_text()
            if page or shows(test, number):
                return test
    return ""


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield (offset, paragraph); a table belongs to the paragraph before it."""
    places = [0, *(one.end() for one in re.finditer(r"\n\s*\n", text)), len(text)]
    held, begin = "", 0
    for low, high in pairwise(places):
        part = text[low:high]
        if part.lstrip().startswith("|") and held:
            held += part
            continue
        if held:
            yield begin, held
        held, begin = part, low
    if held:
        yield begin, held


def of_text(
    file: str, text: str, first: int = 1, code: str = "", tests: str = ""
) -> Iterator[Claim]:
    """Yield the claims in Markdown or in a docstring that begins in a line.

    code : numbers in it are parameters;  tests : words that name tests for the whole text
    """
    blocks = [one[0] for one in FENCE.finditer(text)]
    inline = re.findall(r"`[^`\n]+`", blanked(text, FENCE))
    loaded = re.findall(r"[a-z_]+", " ".join([*blocks, *inline]))
    scenes = [SCENES[word] for word in {*loaded} if word in SCENES]
    known, plain = parameters_of(" ".join([*blocks, *inline, *scenes, code])), text
    for pattern in DROPPED:
        plain = blanked(plain, pattern)
    in_code = file.endswith(".py")
    for begin, part in paragraphs(plain):
        whole = text[begin : begin + len(part)]
        said = [(one.start(), one.end()) for one in DEFAULT.finditer(part)]
        for offset, number in numbers(blanked(part, SOURCE) if in_code else part, known):
            if any(low <= offset < high for low, high in said) and value(number) in defaults():
                continue
            place = begin + offset
            words = " ".join(text[max(0, place - 50) : place + 40].split())
            line = first + text.count("\n", 0, place)
            yield Claim(file, line, number, words, given_by(file, whole, number, tests))


def pages() -> Iterator[Claim]:
    """Yield the claims of README.md and of the pages of docs."""
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        if "_build" not in path.parts and path.name not in ("changelog.md", "bibliography.md"):
            yield from of_text(str(path.relative_to(ROOT)), path.read_text("utf-8"))


def docstrings() -> Iterator[Claim]:
    """Yield the claims of docstrings and help texts of the package."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    for path in sorted((ROOT / "rigidmc").rglob("*.py")):
        tree = ast.parse(path.read_text("utf-8"))
        code = constants(tree)
        for node in ast.walk(tree):
            if isinstance(node, kinds) and (text := ast.get_docstring(node, clean=False)):
                line = node.body[0].lineno
                shown = re.split(r"\n\s*Examples\n", text)[0]
                yield from of_text(str(path.relative_to(ROOT)), shown, line, code, shown)


def helps() -> Iterator[Claim]:
    """Yield the claims of help texts: of options, and of the settings of a run."""
    for path in sorted((ROOT / "rigidmc").rglob("*.py")):
        tree = ast.parse(path.read_text("utf-8"))
        code, file = constants(tree), str(path.relative_to(ROOT))
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        for node in (word.value for call in calls for word in call.keywords if word.arg == "help"):
            text = " ".join(
                n.value
                for n in ast.walk(node)
                if isinstance(n, ast.Constant) and isinstance(n.value, str)
            )
            yield from of_text(file, text, node.lineno, code)


def constants(tree: ast.AST) -> str:
    """Return the numbers in a module's code, and in constants that it imports by name."""
    values = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in constants_of_modules():
            known = constants_of_modules()[node.module]
            values += [known[one.name] for one in node.names if one.name in known]
    return " ".join(f"{v:.17g} {v:g}" for v in values if type(v) in (int, float))


def named_constants(tree: ast.Module) -> dict[str, float]:
    """Return {NAME: number} of a module, also for NAME, NAME = number, number."""
    found = {}
    for node in (one for one in tree.body if isinstance(one, ast.Assign)):
        with suppress(ValueError, TypeError, NameError, SyntaxError, AttributeError):
            values = eval(ast.unparse(node.value), {"__builtins__": {}})
            target = node.targets[0]
            if isinstance(target, ast.Name):
                target, values = ast.Tuple([target]), [values]
            if isinstance(target, ast.Tuple):
                for name, one in zip(target.elts, values, strict=True):
                    found[ast.unparse(name)] = float(one)
    return found


def preset(tree: ast.Module) -> Iterator[float]:
    """Yield the default values of function parameters and class fields that are numbers."""
    for node in ast.walk(tree):
        several = []
        if isinstance(node, ast.FunctionDef):
            several = [*node.args.defaults, *node.args.kw_defaults]
        elif isinstance(node, ast.AnnAssign):
            several = [node.value]
        for one in several:
            if isinstance(one, ast.Constant) and type(one.value) in (int, float):
                yield float(one.value)


@cache
def trees() -> dict[str, ast.Module]:
    """Return {module of the package: its code}."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): ast.parse(path.read_text("utf-8"))
        for path in sorted((ROOT / "rigidmc").rglob("*.py"))
    }


@cache
def constants_of_modules() -> dict[str, dict[str, float]]:
    """Return {module: its `named_constants`}."""
    return {module: named_constants(tree) for module, tree in trees().items()}


@cache
def defaults() -> set[float]:
    """Return the constants and default numbers of the package; bytes also in MB."""
    return {
        known
        for module, tree in trees().items()
        for one in (*constants_of_modules()[module].values(), *preset(tree))
        for known in (one, round(one / 1e6, 0))
    }


def scenes() -> Iterator[Claim]:
    """Yield the claims of the titles, summaries and sources of shipped scenes; their numbers are
    facts of bodies if the source names a publication."""
    for path in sorted((ROOT / "rigidmc" / "scene" / "library").glob("*.toml")):
        text = path.read_text("utf-8")
        scene = tomllib.loads(text)
        source = scene.get("source", "")
        work = re.search(r"\b(1[6-9]|20)\d\d\b|closed form|uniform", source)
        known = parameters_of(re.sub(r"(?m)^(title|summary|source) = .*$|#.*$", "", text))
        for offset, number in numbers(f"{scene.get('summary', '')} {source}", known):
            words = f"{scene.get('summary', '')} {source}"[max(0, offset - 50) : offset + 40]
            yield Claim(str(path.relative_to(ROOT)), 1, number, words, work[0] if work else "")


def claims() -> list[Claim]:
    """Return all claims; those without `given` have no source."""
    return [*pages(), *docstrings(), *helps(), *scenes()]


def main() -> None:
    found = claims()
    everything = "--all" in sys.argv
    for one in found:
        if everything or not one.given:
            note = f"  [{one.given}]" if one.given else ""
            print(f"{one.file}:{one.line}: {one.number}: ... {one.words} ...{note}")
    left = sum(not one.given for one in found)
    print(f"{len(found):,} numbers, {left:,} without a source")


if __name__ == "__main__":
    main()
