"""Shared by all benches: the machine card, interleaved timing, JSON rows, tables."""

import datetime
import json
import os
import platform
import statistics
import string
import time

import llvmlite
import numba
import numpy
from rich.console import Console
from rich.table import Table

import rigidmc
from bench.baselines import compiler_version
from rigidmc.engine.machine import threads_available, use_widest_vectors, vector_bits

HERE = os.path.dirname(os.path.abspath(__file__))


def machine_card():
    """Describe the machine, on which the figures depend, as a dict."""
    use_widest_vectors()  # as a kernel does before its first compilation
    return {
        "cpu": _cpu(),
        "architecture": architecture(),
        "cores": threads_available(),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "vector_bits": vector_bits(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "gcc": compiler_version(),
        "rigidmc": rigidmc.__version__,
        "date": datetime.date.today().isoformat(),
    }


def architecture():
    """Return the name of the instruction set, x86_64 or aarch64: the same on every system."""
    word = platform.machine().lower()
    return {"amd64": "x86_64", "arm64": "aarch64"}.get(word, word)


def _cpu():
    try:
        with open("/proc/cpuinfo") as file:
            facts = dict(
                line.split(":", 1)
                for line in file.read().split("\n\n")[0].splitlines()
                if ":" in line
            )
        facts = {key.strip(): value.strip() for key, value in facts.items()}
        name = (
            f"{facts['model name']} (family {facts.get('cpu family', '?')}, model "
            f"{facts.get('model', '?')})"
        )
        # QEMU shows the file of the CPU that it runs on
        emulated = "cpu family" in facts and architecture() != "x86_64"
        return f"emulated on {name}" if emulated else name
    except (OSError, KeyError):
        return platform.processor() or platform.machine()


def card_text(card):
    """Write the card as one paragraph."""
    return ", ".join(f"{key} {value}" for key, value in card.items())


def interleaved(candidates, rounds, cpu=None):
    """Time candidates: every round runs all of them and starts one further on.

    Returns {name: seconds of each round}.

    candidates : {name: function} or {name: (prepare, function)}
    cpu : a dict that receives {name: CPU seconds of each round}, all threads together

    The result of prepare() goes to the function and is not timed. Each candidate runs once untimed
    before the first round, so that no round compiles. The load of a shared machine changes within
    seconds: trust ratios within a round, and CPU seconds if other work occupies a core permanently.
    """
    names = list(candidates)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for name in names:
        once(candidates[name])
    for i in range(rounds):
        for name in names[i % len(names) :] + names[: i % len(names)]:
            wall, busy = once(candidates[name])
            seconds[name].append(wall)
            if cpu is not None:
                cpu.setdefault(name, []).append(busy)
    return seconds


def once(candidate):
    """Return (seconds, CPU seconds of all threads) of one run of a candidate."""
    prepare, function = candidate if isinstance(candidate, tuple) else (None, candidate)
    given = (prepare(),) if prepare else ()
    began, busy = time.perf_counter(), time.process_time()
    function(*given)
    return time.perf_counter() - began, time.process_time() - busy


def ratio(numerator, denominator):
    """Return the median over rounds of the ratio of two lists of seconds, round by round."""
    return statistics.median(a / b for a, b in zip(numerator, denominator, strict=True))


def median(values):
    """Return the median of a list, nan if it is empty."""
    return statistics.median(values) if values else float("nan")


def target(what, asked, measured, unit="", at_most=False, aim=False, note=""):
    """Return a row of the closing table: target and measurement. aim: desired, not required."""
    met = None if measured is None else bool(measured <= asked if at_most else measured >= asked)
    row = {"kind": "target", "what": what, "asked": asked, "measured": measured, "unit": unit}
    return {**row, "met": met, "at_most": at_most, "aim": aim, "note": note}


def asked_text(row):
    """Describe the target of a row."""
    return (
        f"{'at most' if row['at_most'] else 'aim' if row['aim'] else 'at least'} "
        f"{row['asked']:g} {row['unit']}"
    ).strip()


def measured_text(row):
    """Describe the measurement of a row."""
    return (
        "not measured"
        if row["measured"] is None
        else f"{row['measured']:.3g} {row['unit']}".strip()
    )


def met_text(row):
    """Describe whether a target is met."""
    return {True: "yes", False: "not yet" if row["aim"] else "NO", None: "-"}[row["met"]]


def report_targets(rows):
    """Print the closing table: asked, measured, met."""
    texts = {"told": asked_text, "found": measured_text, "is_met": met_text}
    columns = " {what} | asked {told} | measured {found} | met {is_met} | {note}"
    show("asked and measured", of_kind(rows, "target"), columns, **texts)


def row(kind, **fields):
    """Return a row of a kind."""
    return {"kind": kind, **fields}


def of_kind(rows, kind):
    """Return the rows of a kind."""
    return [row for row in rows if row["kind"] == kind]


class _Cells(string.Formatter):
    def format_field(self, value, spec):
        return "-" if value is None else super().format_field(value, spec)


def cells_of(rows, columns, **more):
    """Return (titles, lines of texts) of rows.

    columns : texts "TITLE {FIELD:FORMAT}" between |, with the fields of a row and of `more`
    more : {FIELD: function of a row}
    """
    parts = [one.partition("{") for one in columns.split("|")]
    lines = []
    for row in rows:
        fields = row | {name: function(row) for name, function in more.items()}
        lines.append([_Cells().vformat(f"{a}{b}".strip(), (), fields) for _, a, b in parts])
    return [title.strip() for title, _, _ in parts], lines


def show(title, rows, columns, **more):
    """Print rows as a table; columns and more as in `cells_of`."""
    table(title, *cells_of(rows, columns, **more))


def at_most(what, asked, measured, unit="", **more):
    """Return a row of the closing table whose measurement may not exceed its target."""
    return target(what, asked, measured, unit, at_most=True, **more)


def table(title, columns, lines):
    """Print a table; no cell is cut, however narrow the terminal."""
    sheet = Table(*columns, title=title, title_justify="left")
    for i, column in enumerate(sheet.columns):
        column.justify = "left" if i == 0 or i == len(columns) - 1 else "right"
    for line in lines:
        sheet.add_row(*(str(cell) for cell in line))
    Console(width=max(120, Console().width)).print(sheet)


def write(folder, name, rows):
    """Write {"machine": card, "rows": rows} to folder/name.json; return its path."""
    os.makedirs(folder, exist_ok=True)
    path = os.path.join(folder, f"{name}.json")
    with open(path + ".tmp", "w") as file:
        json.dump({"machine": machine_card(), "rows": rows}, file, indent=1)
        file.write("\n")
    os.replace(path + ".tmp", path)
    return path
