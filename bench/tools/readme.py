"""Redraw the tables of README.md and docs/ from bench/results/*.json: python -m bench.readme."""

import glob
import json
import os
import re
import sys
import textwrap
from functools import partial
from pathlib import Path
from statistics import median

from bench import harness
from bench.accuracy import step_text

ROOT = str(Path(__file__).parents[2])
RESULTS = os.path.join(ROOT, "bench", "results")


def main():
    tables = dict(drawn())
    for name, path in [(name, path) for path in pages() for name in tables]:
        with open(path, encoding="utf-8") as file:
            before = file.read()
        text = replaced(before, name, tables[name])
        if text != before:
            with open(f"{path}.tmp", "w", encoding="utf-8") as file:
                file.write(text)
            os.replace(f"{path}.tmp", path)
            print(f"{os.path.relpath(path, ROOT)}: {name} redrawn")


def pages():
    """Return the paths of README.md and the pages of docs/."""
    docs = glob.glob(os.path.join(ROOT, "docs", "**", "*.md"), recursive=True)
    return [os.path.join(ROOT, "README.md"), *sorted(p for p in docs if "_build" not in p)]


def drawn():
    """Yield (name, table) for every bench that has rows."""
    for name, draw in DRAWN.items():
        bench = "coming_from" if name.startswith("coming_from_") else name
        path = os.path.join(RESULTS, f"{bench}.json")
        if not os.path.exists(path):
            message = f"{name}: no bench/results/{bench}.json; run python -m bench {bench}"
            print(message, file=sys.stderr)
            continue
        with open(path) as file:
            result = json.load(file)
        yield name, draw(result["rows"], result["machine"])


def replaced(text, name, content):
    """Return the text with new content between the markers of `name`."""
    pattern = rf"(<!-- bench:{name} -->\n).*?(<!-- /bench:{name} -->)"
    return re.sub(
        pattern, lambda found: found[1] + content + "\n" + found[2], text, flags=re.DOTALL
    )


def table(columns, lines):
    """Return a markdown table with right-aligned numbers."""
    rule = ["---" if i == 0 else "---:" for i in range(len(columns))]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in [columns, rule, *lines])


def listed(rows, columns, **more):
    """Return a markdown table of rows; columns and more as in `harness.cells_of`."""
    return table(*harness.cells_of(rows, columns, **more))


def with_note(drawn, note):
    """Return a table with a note below it."""
    return f"{drawn}\n\n{textwrap.fill(note, 100, break_long_words=False, break_on_hyphens=False)}"


def accuracy(rows, machine):
    """Return a table of the fastest integrator for each error, and of others that reach it."""
    choices = harness.of_kind(rows, "choice")

    def others(row):
        same = [r for r in choices if (r["body"], r["limit"]) == (row["body"], row["limit"])]
        rates = (f"{r['integrator']} {_count(r['members_per_second'])}" for r in same[1:5])
        return ", ".join(rates)

    drawn = listed(
        [row for row in choices if row["best"]],
        "tops {body} | error limit after 10 s {limit:.0e} | integrator, step {integrator}, {step}"
        " | members per second {rate} | other integrators {others}",
        step=step_text,
        rate=lambda row: _count(row["members_per_second"]),
        others=others,
    )
    words = (
        "For 99 % of random tops the errors of momentum (relative) and attitude (rad) are below "
        "this limit. A step in rad is an angle: every top has its own time step, in which it turns "
        "by that angle"
    )
    return with_note(drawn, f"{words}. Measured on {_machine(machine)}.")


def loop(rows, _):
    """Return a paragraph on the loop that rigidmc replaces, with the factors."""
    factor = {row["limit"]: _rounded(row["factor"]) for row in rows if row["kind"] == "factor"}
    compiling = next(row["seconds"] for row in rows if row["kind"] == "compilation")
    words = (
        "It replaces a loop over scipy's `solve_ivp`: on the same cores, with an error of 1e-6, "
        f"this loop takes {factor[1e-6]} times as long for heavy tops ({factor[1e-4]} at 1e-4, "
        f"{factor[1e-8]} at 1e-8; `python -m bench loop`). The first run of a scene also compiles,"
        f" here for {compiling:.0f} s"
    )
    return textwrap.fill(f"{words}.", 100, break_long_words=False, break_on_hyphens=False)


def _rounded(factor):
    """Format a factor to two digits."""
    return f"{float(f'{factor:.2g}'):,.0f}"


def peers(rows, machine):
    """Return a table of seconds by candidate and worst error, with the settings of rigidmc."""
    times = {(r["body"], r["limit"], r["name"]): r for r in rows if r["kind"] == "time"}
    names = list(dict.fromkeys(name for _, _, name in times))
    others = "rigidmc, closed form", "rigidmc, 100 saves", "heyoka, 100 saves"
    plain = [name for name in names if name not in others]
    lines = []
    for body, limit in dict.fromkeys((body, limit) for body, limit, _ in times):
        found = [times.get((body, limit, name)) for name in plain]
        seconds = [f"{r['seconds']:.4f}" if r else "not reached" for r in found]
        lines.append((f"{body}, {limit:.0e}", *seconds))
    ours = "; ".join(
        f"{b}, {limit:.0e}: {r['setting']}"
        for (b, limit, name), r in times.items()
        if name == "rigidmc"
    )
    closed = times.get(("free", 1e-9, "rigidmc, closed form"))
    more = f" Free tops by the closed form: {closed['seconds']:.4f} s." if closed else ""
    words = (
        "Seconds for 4,096 different tops to t = 10 s; the error is the error in omega and "
        f"attitude of the worst top. Settings of rigidmc: {ours}.{more}"
    )
    return with_note(table(("tops, worst error", *plain), lines), f"{words} {_machine(machine)}.")


def throughput(rows, machine):
    """Return a table of member-steps per second, also relative to plain C."""
    rates = {r["name"]: r for r in rows if r["kind"] == "rate"}

    def cell(name, baseline):
        if name not in rates:
            return ""
        speed, base = rates[name]["undisturbed"], rates.get(baseline)
        return f"{speed:.0f}" + (f" ({speed / base['undisturbed']:.2f}x)" if base else "")

    base = "C structure of arrays, free", "C structure of arrays, heavy"
    pairs = {
        "rigidmc, rk4, kernel": ("kernel rk4 free", "kernel rk4 heavy"),
        "rigidmc, rk4, `simulate()`": tuple(
            f"simulate rk4 {kind}, final state" for kind in ("free", "heavy")
        ),
        "rigidmc, rk4, `simulate()` with 100 saves of 9 values": (
            "simulate rk4 free, 100 saves",
            "",
        ),
        "rigidmc, exact (free) / strang (heavy)": ("kernel exact", "kernel strang heavy"),
        "rigidmc, exact, momentum only": ("kernel exact, momentum only", ""),
        "C, structure of arrays, gcc -O3 -march=native -ffast-math": base,
        "C, structure of arrays, with the same 100 saves": (
            "C structure of arrays, free, 100 saves",
            "",
        ),
        "C, explicit 512-bit vectors, few operations": (
            "C 512-bit intrinsics, free",
            "C 512-bit intrinsics, heavy",
        ),
        "Numba `prange` over tops": ("naive prange, free", "naive prange, heavy"),
    }
    lines = [
        (what, cell(free, base[0]), cell(heavy, base[1])) for what, (free, heavy) in pairs.items()
    ]
    words = (
        "Million member-steps per second of CPU time, float64, 65,536 different tops, all cores; "
        "in brackets relative to plain C"
    )
    return with_note(table(("", "free", "with gravity"), lines), f"{words}; {_machine(machine)}.")


def runs(rows, machine):
    """Return a table of memory and time of runs that write to a directory."""
    drawn = listed(
        harness.of_kind(rows, "peak")[1:],  # the first compiles
        "members {members:,} | GB of memory {gigabytes:.2f} | seconds {seconds:.0f}"
        " | GB written {written:.2f}",
        written=lambda r: r["bytes"] / 1e9,
    )
    found = {r["what"]: r["measured"] for r in harness.of_kind(rows, "target")}
    share, ratio = (
        next(v for k, v in found.items() if word in k) for word in ("writing adds", "cluster here")
    )
    taken = harness.of_kind(rows, "cluster")
    whole = median([r["threads"] / r["cluster"] for r in taken])
    seconds = median([r["threads"] for r in taken])
    words = (
        "Free tops with attitude over 1,200 steps, final state written to a run directory; "
        f"writing adds {100 * share:.0f} % to the time of this short run"
        f"; two processes of a local cluster reach {ratio:.2f} of the speed of two threads, "
        f"{whole:.2f} in a run of {seconds:.0f} s including start-up"
    )
    return with_note(drawn, f"{words}; {_machine(machine)}.")


def workers(rows, machine):
    """Return a table of stubs of shards on simulated clusters."""
    words = {
        "many": "", "wide": "", "lost": "one worker lost every second",
        "adaptive": "started without workers, shards of 3 s",
        "restart": "scheduler lost, then resumed",
    }  # fmt: skip
    some = [row for row in rows if row["kind"] in words]
    drawn = listed(
        some,
        "shards {all:,} | workers {count:,} | {how} | ms of scheduler {scheduler[ms]:.2f}"
        " | of client {client[ms]:.2f} | of worker {workers[ms]:.2f}"
        " | MB of scheduler {scheduler[megabytes][1]:.0f} | of client {client[megabytes][1]:.0f}"
        " | s of status {status:.2f}",
        all=lambda r: r["shards"] + r.get("before", {}).get("done", 0),
        how=lambda r: words[r["kind"]] or r.get("beside", ""),
    )
    most = max(some, key=lambda r: r["shards"])
    note = (
        "CPU time of a task in each process, and memory at the end, of shards without work:"
        f" {1e3 / most['scheduler']['ms']:.0f} tasks a second keep one scheduler busy. All workers"
        " are objects in one process, and do not watch its loop and files. journal.jsonl has"
        f" {most['journal.jsonl']:,} bytes at the end, and run.json {most['run.json']:,}: neither"
        f" grows with the shards. {_machine(machine)}."
    )
    return with_note(drawn, note)


def billion(rows, machine):
    """Return a table of runs of which only totals are kept."""
    drawn = listed(
        harness.of_kind(rows, "whole"),
        "members {members:,} | GB {gigabytes:.2f} | s {seconds:,.1f} | million/s {rate:.1f}"
        " | {how}",
        rate=lambda r: r["members"] / r["seconds"] / 1e6,
        how=lambda r: r.get("beside", ""),
    )
    rate = next(r for r in rows if r.get("what", "").startswith("rate"))
    note = (
        "Free tops for 100 steps, with a histogram, two means and a probability:"
        f" {rate['measured']:.2f} of the rate without totals. {_machine(machine)}."
    )
    return with_note(drawn, note)


def reading(rows, machine):
    """Return a table of the times to read a run directory."""
    row = next(r for r in rows if r["kind"] == "reading")
    memory = next(r["measured"] for r in rows if r.get("unit") == "GB")
    words = {"open": "`rm.open`", "mean": "mean of one variable", "summary": "`rigidmc summary`"}
    note = (
        f"{row['members']:,} members in {row['shards']:,} shards, in the cache of the system; at"
        f" most {memory:.1f} GB of memory; {_machine(machine)}."
    )
    return with_note(table(("", "s"), [(w, f"{row[n]:.2g}") for n, w in words.items()]), note)


def maps(rows, machine):
    """Return a table of time and memory of maps and large studies."""
    heads, lines = harness.cells_of(
        harness.of_kind(rows, "map"),
        " {what} | members {all:,} | s {seconds:.0f} | GB {gigabytes:.1f} | {words}: {number:.4g}",
        what=lambda r: f"`rigidmc map {r['name']} --resolution {r['side']}`",
        all=lambda r: r["side"] ** 2 * r["members"],
    )
    _, more = harness.cells_of(
        harness.of_kind(rows, "millions"),
        " {what} | members {members:,} | s {seconds:.0f} | GB {gigabytes:.1f} |",
        what=lambda r: f"free tops to {r['t_end'] / 6.2831853:.0f} turns, flips counted",
    )
    words = "Run from the shell, including compilation and the picture"
    return with_note(table(heads, lines + more), f"{words}; {_machine(machine)}.")


def gpu(rows, machine):
    """Return a table of GPU instructions and registers of the kernels of every integrator."""
    kernels = {
        (row["integrator"], row["acting"]): row
        for row in rows
        if row["kind"] == "ptx" and row["capability"] == "sm_90" and not row["watched"]
    }
    names = list(dict.fromkeys(name for name, _ in kernels))
    acting = list(dict.fromkeys(word for _, word in kernels))
    lines = [
        (
            name,
            *(kernels[name, "nothing"][word] for word in ("fma", "add and mul", "div", "sqrt")),
            *(kernels.get((name, word), {}).get("registers", "") for word in acting),
        )
        for name in names
    ]
    spills = sorted(row["spills in steps"] for row in kernels.values() if row["spills in steps"])
    words = (
        "Float64 instructions of a kernel without effects (fused multiply-adds, sums and products,"
        " divisions, square roots; start and health checks included), and registers per thread by"
        " the effects that act, as reported by `ptxas` for compute capability 9.0. No kernel spills"
        " registers within its steps, except the kernels with all effects at once:"
        f" {spills[0]:,} to {spills[-1]:,} bytes"
    )
    drawn = table(("", "fma", "add, mul", "div", "sqrt", *acting), lines)
    return with_note(drawn, f"{words}.")


def device(rows, machine):
    """Return tables of steps per second on a GPU, of CUDA C and JAX on the same GPU, of
    derivatives, and of whole runs."""
    card = next(row for row in rows if row["kind"] == "card")
    speeds = [row for row in rows if row["kind"] == "speed" and row["members"] == 2**19]
    names = list(dict.fromkeys(row["integrator"] for row in speeds))
    cells = {
        (row["what"], row["integrator"]): f"{row['speed'] / 1e9:.3g} ({100 * row['share']:.0f} %)"
        for row in speeds
    }
    lines = [
        (what, *(cells.get((what, name), "") for name in names))
        for what in dict.fromkeys(row["what"] for row in speeds)
    ]
    words = (
        f"{card['name']}, driver {card['driver']}: 10^9 member-steps per second in float64 with"
        f" {2**19:,} members on the GPU, excluding copies; in brackets, the fraction of the GPU's"
        f" peak of {card['peak'] / 1e12:.1f} T operations per second. `exact` integrates free"
        " members only"
    )
    steps = with_note(table(("", *names), lines), f"{words}.")
    compared = with_note(*_compared(rows, speeds))
    costs = with_note(*_derivatives_on_gpu(rows))
    whole = listed(
        harness.of_kind(rows, "whole"), " {what} | members {members:,} | s {seconds:.1f}"
    )
    words = (
        f"Whole runs, from the call to the result, on this GPU and {machine['cores']} CPU cores,"
        " which draw the starts and gather the results"
    )
    return "\n\n".join([steps, compared, costs, with_note(whole, f"{words}.")])


def _compared(rows, speeds):
    """Return a table of rk4 by rigidmc, CUDA C and JAX, and its note."""
    of = {}
    for row in speeds:
        if row["integrator"] == "rk4" and row["what"] in ("free", "heavy"):
            of["rigidmc", row["members"], row["what"]] = row["speed"]
    for row in (row for row in rows if row["kind"] == "peer"):
        what = "heavy" if row["name"].endswith(", heavy") else "free"
        name = row["name"].removesuffix(", heavy")
        of[name, row["members"], what] = row["speed"]
    lines = [
        (name, f"{members:,}",
         *(f"{of[name, members, what] / 1e9:.3g}" if (name, members, what) in of else ""
           for what in ("free", "heavy")))
        for name, members in dict.fromkeys(
            key[:2] for key in sorted(of, key=lambda key: (key[1], key[0] != "rigidmc"))
        )
    ]  # fmt: skip
    words = (
        "Steps of rk4, momentum and attitude in float64, 10^9 per second on the same GPU. Members"
        " of rigidmc and CUDA C have individual moments; JAX members share theirs. Only rigidmc"
        " flags a member that fails"
    )
    return table(("", "members", "free", "heavy"), lines), f"{words}."


def _derivatives_on_gpu(rows):
    """Return a table of the cost of derivatives, and its note."""
    of = {}
    for row in (row for row in rows if row["kind"] == "derivatives"):
        of.setdefault((row["integrator"], row["what"]), {})[row["count"], row["at_once"]] = row
    cases = {(1, 1): "1", (3, 3): "3 in one pass", (3, 1): "3 one by one"}
    lines = [
        (f"{name}, {what}",
         *(f"{of[name, what][case]['ratio']:.1f}" if case in of[name, what] else ""
           for case in cases))
        for name, what in of
    ]  # fmt: skip
    words = (
        "Steps with derivatives by moments of inertia, in plain steps of the same members on the"
        " same GPU. A run computes one by one where that is faster, and else three in one pass"
    )
    return table(("derivatives", *cases.values()), lines), f"{words}."


def coming_from(rows, machine, page, tasks):
    """Return a table of both programs of a page: errors, seconds, first runs, imports."""
    mine = [row for row in rows if row.get("page") == page]
    times = {(r["program"], r["task"]): r["seconds"] for r in mine if r["kind"] == "time"}
    starts = [row for row in mine if row["kind"] == "start"]
    order = [(start, task) for task in tasks for start in starts if start["task"] == task]
    lines = [
        (
            tasks[task],
            start["program"],
            "" if start["error"] is None else f"{start['error']:.1e}",
            f"{times[start['program'], task]:.2g}",
        )
        for start, task in order
    ]
    first = {}
    for start in starts:
        first.setdefault(start["program"], start)
    loading = "; ".join(
        f"{name} {start['version']}: import {start['import']:.2g} s, first run"
        f" {start['first']:.2g} s"
        + ("" if start["cached"] is None else f" ({start['cached']:.2g} s from the cache)")
        for name, start in first.items()
    )
    words = (
        "Error: the larger of attitude (rad) and omega (relative), of the worst member. Seconds:"
        " the median of interleaved runs, after a first run that compiles or loads the program."
        f" {loading}. {_machine(machine)}."
    )
    if any(row["kind"] == "load" and row["busy"] for row in rows):
        words += " The machine was busy with other processes: times are rough."
    if skipped := [row["why"] for row in mine if row["kind"] == "skipped"]:
        words += f" Skipped: {skipped[0]}."
    return with_note(table(("", "program", "error", "s"), lines), words)


def bits(rows, machine):
    """Return a table of the CPUs, widths and cases whose checksums are compared."""
    truth, lines, found = {}, {}, []
    for row in rows:
        if row["kind"] == "bits":
            truth.setdefault(row["case"], row["sums"][0])
            words = row["architecture"], row["processor"]
            lines.setdefault(words, []).append(row)
    machines = {row["architecture"]: row for row in rows if row["kind"] == "machine"}
    for (word, processor), mine in lines.items():
        own = processor.startswith("this processor")
        more = processor.removeprefix("this processor")  # ", with derivatives"
        name = machines[word]["cpu"] + more if own else f"the same, code for {processor}"
        width = ", ".join(str(one or "its own") for one in mine[0]["widths"])
        same = sum(set(row["sums"]) == {truth[row["case"]]} for row in mine)
        found.append((word.replace("_", "-"), name, width, f"{same} of {len(mine)}"))
    columns = ("", "CPU", "members side by side", "cases with the same bits")
    return table(columns, found)


def derivatives(rows, machine):
    """Return tables of the cost of derivatives, with their errors and heyoka's time beside it."""
    of = {word: [r for r in rows if r["kind"] == word] for word in {r["kind"] for r in rows}}
    times = "; ".join(f"{row['name']} {row['milliseconds']:.0f} ms" for row in of["peer"])
    ending = ", tangents over 10 s"
    errors = ", ".join(
        f"{row['what'].removesuffix(ending)} {row['measured']:.1e}"
        for row in of["target"]
        if row["what"].endswith(ending)
    )
    note = f"""4,096 heavy tops to 10 s with derivatives by their seven starts, right to 1e-9:
    {times}. Errors over 10 s: {errors}. {_machine(machine)} (`python -m bench derivatives`)."""
    tables = (
        ("cost", "derivatives {name} | plain runs {ratio:.1f}", " ".join(note.split())),
        ("call", "derivatives of a call {name} | ms {ms:.2f} | in the steps {steps_ms:.2f}",
         "A call of a prepared run of 32 heavy tops with other values: 20 steps of rk4."),
        ("first", " {name} | s {seconds:.1f}",
         "rk4 with gravity in a new process with an empty cache, which compiles."),
        ("registers", "heavy tops {integrator} | derivatives {derivatives} | registers {registers}"
         " | local memory [B] {local} | spills [B] {spills} | in the steps [B] {spills in steps}",
         "Registers of a thread, of 255 at most, and memory, for compute capability 9.0."),
    )  # fmt: skip
    drawn = [
        with_note(listed(of[kind], *columns), note) for kind, *columns, note in tables if kind in of
    ]
    return "\n\n".join(drawn)


PAGES = {  # page on coming from another program: {task: words}
    "basilisk": {"one": "one hub", "ensemble": "4,096 hubs"},
    "mujoco": {"one": "one top", "ensemble": "64 tops"},
    "heyoka": {"one": "one top", "ensemble": "4,096 tops"},
    "diffrax": {"ensemble": "4,096 satellites", "exact": "the same, closed form"},
    "rebound": {"one": "one moon", "ensemble": "4,096 moons"},
    "sympy": {"one": "one top"},
}


def _machine(machine):
    return f"{machine['cores']} cores of {machine['cpu']}, {machine['vector_bits']}-bit vectors"


def _count(number):
    """Format a number to two digits, for people."""
    for size, word in ((1e6, " M"), (1e3, " k")):
        if number >= size:
            return (
                f"{number / size:.2g}{word}"
                if number < 99.5 * size
                else f"{number / size:.0f}{word}"
            )
    return f"{number:.2g}"


DRAWN = {
    "accuracy": accuracy,
    "bits": bits,
    "derivatives": derivatives,
    "loop": loop,
    "peers": peers,
    "throughput": throughput,
    "maps": maps,
    "runs": runs,
    "workers": workers,
    "reading": reading,
    "billion": billion,
    "gpu": gpu,
    "device": device,
    **{
        f"coming_from_{page}": partial(coming_from, page=page, tasks=tasks)
        for page, tasks in PAGES.items()
    },
}

if __name__ == "__main__":
    main()
