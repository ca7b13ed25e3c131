"""sha256 of everything that users of rigidmc see, to show that a code change alters none of it.

    python -m bench.fingerprints --record              writes bench/fingerprints.json
    python -m bench.fingerprints --compare             lists differences; exit code 1 if any
    python -m bench.fingerprints --compare --only errors,help    some kinds alone
    python -m bench.fingerprints --record --texts DIR --file NEW.json    writes the texts too

To see what has changed, write the texts before and after, and run `diff -r`. Everything is a text,
even a result: a line for each variable with the sha256 of its bytes. `bench.kinds` defines the
items, `bench.mistakes` has the mistakes whose messages are compared, and `bench.texts` masks values
that depend on the machine and the clock. Everything stays the same with another number of threads,
an empty kernel cache or code for an older CPU (NUMBA_CPU_NAME=haswell); other library versions
change help pages, pictures and bytes of files.
"""

import argparse
import contextlib
import json
import os
import re
import sys
import tempfile
import traceback
import warnings

from bench.tools import texts

RECORD = os.path.join(os.path.dirname(os.path.dirname(__file__)), "fingerprints.json")


def texts_of(names, threads, strict=False):
    """Return ({kind: {item: text}}, kinds that stopped), and print how long each takes.

    strict : whether to raise the error that stops a kind
    """
    import rigidmc as rm
    from bench.tools.kinds import KINDS

    found, stopped = {}, []
    for name in names:
        began = sum(os.times()[:4])  # helper processes compile and try hard cases
        here = found[name] = {}
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="rigidmc-"))
            stack.enter_context(contextlib.chdir(folder))
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore", rm.SceneWarning)
            try:
                for item, text in KINDS[name](threads):
                    if item in here:
                        raise RuntimeError(f"two items are {item}")
                    here[item] = text
            except Exception:
                if strict:
                    raise
                traceback.print_exc()
                stopped.append(name)
        seconds = sum(os.times()[:4]) - began
        print(f"{name:16s} {len(here):4d} items, {seconds:.0f} s of CPU time", flush=True)
    return found, stopped


def shas_of(found):
    """Return {kind: {item: 16 digits of the sha256}} of {kind: {item: text}}."""
    return {
        name: {item: texts.sha(text)[:16] for item, text in items.items()}
        for name, items in found.items()
    }


def differences(old, new, stopped=()):
    """List what differs in the kinds of `new`, one line for each item."""
    lines = [f"{name}: stopped" for name in stopped]
    for name, items in new.items():
        known = old.get(name, {})
        for item in sorted({*known, *items} if name not in stopped else items):
            if known.get(item) != items.get(item):
                word = "new" if item not in known else "gone" if item not in items else "changed"
                lines.append(f"{name}: {item}: {word}")
    return lines


def write_texts(folder, found):
    """Write each text to FOLDER/KIND/ITEM.txt."""
    for name, items in found.items():
        os.makedirs(os.path.join(folder, name), exist_ok=True)
        for item, text in items.items():
            # items that differ only in characters that file names lack would share a file
            more = f" {texts.sha(item)[:4]}" if re.search(r"[^\w .,()+-]", item) else ""
            place = re.sub(r"[^\w .,()+-]", "_", item)[:120] + more
            with open(os.path.join(folder, name, f"{place}.txt"), "w", encoding="utf-8") as file:
                file.write(text)


def read(path):
    """Read a record; {} if there is none."""
    if not os.path.exists(path):
        return {}
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def options_of(arguments):
    """Parse the options, with the kinds as `kinds`."""
    from bench.tools.kinds import KINDS

    parser = argparse.ArgumentParser(
        prog="python -m bench.fingerprints",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--record", action="store_true", help="write the record")
    what.add_argument("--compare", action="store_true", help="compare with the record")
    parser.add_argument("--only", metavar="KIND,...", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--file", default=RECORD, help="the record; by default %(default)s")
    parser.add_argument("--texts", metavar="DIR", help="write the texts there")
    parser.add_argument("--threads", type=int, default=2, help="results do not depend on it")
    options = parser.parse_args(arguments)
    options.kinds = options.only.split(",") if options.only else list(KINDS)
    if unknown := [name for name in options.kinds if name not in KINDS]:
        parser.error(f"no kind {', '.join(unknown)}; available: {', '.join(KINDS)}")
    return options


def main(arguments=None):
    """Run the command and return its exit code."""
    options = options_of(arguments)
    os.environ.update(texts.TERMINAL)
    found, stopped = texts_of(options.kinds, options.threads, strict=options.record)
    if options.texts:
        write_texts(options.texts, found)
    old, new = read(options.file), shas_of(found)
    if options.record:
        with open(options.file, "w", encoding="utf-8") as file:
            json.dump({**old, **new}, file, indent=1, sort_keys=True)
            file.write("\n")
        return 0
    lines = differences(old, new, stopped)
    print("\n".join(lines) or f"all {sum(map(len, new.values())):,} items are the same")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
