"""Everything that users of rigidmc see, as texts that do not vary between runs; for
`bench.fingerprints`."""

import contextlib
import functools
import hashlib
import inspect
import json
import os
import re
import sys

import numpy as np
import xarray as xr

# The width and the colours of help pages; typer reads these when it is imported.
TERMINAL = {"COLUMNS": "100", "TERMINAL_WIDTH": "100", "NO_COLOR": "1", "TERM": "dumb"}
# attributes and variables of results that are measured, or name the machine
OF_MACHINE = ("seconds", "threads")
MEASURED = ("ns_per_member_step", "ns_per_member", "members_per_second", "cheapest", "seconds")


# All that bench.fingerprints uses of rigidmc, besides `import rigidmc`.


def commands():
    """Return the application of the command line."""
    from rigidmc.cli import app

    return app


@contextlib.contextmanager
def side_by_side(width):
    """Set the number of members per vector: replaces `lanes_for`, whichever module has it."""
    import rigidmc

    assert rigidmc.simulate  # loads the engine
    inside = [module for name, module in sys.modules.items() if name.startswith("rigidmc.")]
    homes = [(module, module.lanes_for) for module in inside if hasattr(module, "lanes_for")]
    if not homes:
        raise RuntimeError("no module of rigidmc has `lanes_for`: fix bench/tools/texts.py")
    asked = []
    try:
        for home, _ in homes:
            home.lanes_for = lambda dtype: asked.append(dtype) or width
        yield
    finally:
        for home, kept in homes:
            home.lanes_for = kept
    if not asked:  # a scene keeps its program: use a new one
        raise RuntimeError("no program was made for this vector width")


# (pattern of a varying text, its replacement): masks measured numbers, not the words around them
NUMBER = r"[-+]?\d[\d,.]*(?:e[-+]?\d+)?"
MASKS = [(re.compile(old), new) for old, new in (
    # show: times of steps, what they add up to, free memory, and shards, which are sized by time
    (rf"{NUMBER} ns\b", "# ns"),
    (rf"measured {NUMBER} times that", "measured # times that"),
    (rf"about {NUMBER} s for the steps", "about # s for the steps"),
    (rf"; {NUMBER} .?B free", "; # free"),
    (rf"{NUMBER} shards of {NUMBER} members with -o RUN/(, limited by time;)?", "# shards"),
    # show: whether code is in the cache
    (r"(?m)^code  .*$", "code"),
    # run, map, stress, status: how long it took and how fast it was
    (rf"(?m)^  {NUMBER} s, {NUMBER}( .)? member-steps/s, {NUMBER}( .)? members/s;.*$", "  #"),
    (rf"(with \w+): {NUMBER} s, {NUMBER}( .)? members/s", r"\1: #"),
    (rf"{NUMBER} members/s since the last start.*", "# members/s"),
    (rf"{NUMBER} s of work", "# s of work"),
    # studies: their predicted cost
    (rf"about {NUMBER} s on \d+ threads", "about # s on # threads"),
    # status: the CPU and the versions
    (r"code generated for .*", "code generated for #"),
    # verify: a shard's name ends in the sha256 of its bytes, which depend on the netCDF library too
    (r"-[0-9a-f]{16}\.nc", "-#.nc"),
    # the repr of a class names its module, which users never write
    (r"<class 'rigidmc\.[\w.]*?(\w+)'>", r"<class '\1'>"),
)]  # fmt: skip


def masked(text):
    """Mask everything in a text that depends on machine, clock, folder and version."""
    import rigidmc

    text = text.replace(os.getcwd(), "FOLDER").replace(rigidmc.__version__, "VERSION")
    # compiling is announced only while the code is not in the cache
    text = "".join(line for line in text.splitlines(True) if not line.startswith("compiling "))
    for old, new in MASKS:
        text = old.sub(new, text)
    return text


@functools.cache
def _runner():
    """Return an object that calls commands in this process; they are made once, in 25 ms."""
    import typer.main
    import typer.testing

    typer.testing._get_command = functools.cache(typer.main.get_command)
    return typer.testing.CliRunner()


def told(*words):
    """Return a command's output and its exit code; RuntimeError for a traceback."""
    done = _runner().invoke(commands(), [str(word) for word in words])
    if done.exit_code in (130, 143):  # it was stopped, so stop this process too
        raise KeyboardInterrupt
    if not isinstance(done.exception, SystemExit | None):
        raise RuntimeError(f"traceback: rigidmc {' '.join(map(str, words))}") from done.exception
    return f"{masked(done.stdout + done.stderr)}exit code {done.exit_code}\n"


def done_well(*words, codes=(0, 4)):
    """Return the same as `told`; RuntimeError for another exit code."""
    text = told(*words)
    if int(text.split()[-1]) not in codes:
        raise RuntimeError(f"rigidmc {' '.join(map(str, words))}: {text}")
    return text


def sha(data):
    """Return the sha256 of a text or of bytes."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()


def bytes_of(array):
    """Return the bytes of an array; texts are alike as objects and as letters."""
    array = np.asarray(array)
    if array.dtype.kind in "OUT":
        return json.dumps([str(word) for word in array.ravel()]).encode()
    return np.ascontiguousarray(array).tobytes()


def parts_of(ds):
    """Yield (part, text) of a Dataset: its variables, its attributes, and the scene in these."""
    for name in sorted(map(str, ds.variables)):
        one = ds[name].variable
        kind = "text" if one.dtype.kind in "OUT" else one.dtype.str
        if name not in MEASURED:
            line = f"{one.dims} {one.shape} {kind} {sha(bytes_of(one.values))}"
            yield name, f"{line}\n{_attributes(one.attrs)}"
    yield "attributes", _attributes({k: v for k, v in ds.attrs.items() if k != "scene"})
    if "scene" in ds.attrs:
        yield "scene in it", masked(ds.attrs["scene"])


def _attributes(attrs):
    """Write attributes, one a line, alike from memory and from a file."""
    lines = []
    for name, value in sorted(attrs.items()):
        if name not in OF_MACHINE:
            plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
            lines.append(f"  {name} = {masked(plain) if isinstance(plain, str) else plain!r}\n")
    return "".join(lines)


def each(name, ds):
    """Return (item, text) of the parts of a Dataset."""
    return ((f"{name}: {part}", text) for part, text in parts_of(ds))


def whole(ds):
    """Write a Dataset as one text."""
    return "".join(f"{part}: {text}" for part, text in parts_of(ds))


def stored(path):
    """Write a netCDF file as one text, as xarray reads it."""
    with xr.open_dataset(path, decode_times=False) as ds:
        return whole(ds)


def pixels(path):
    """Write a picture as a text: its size and the sha256 of its pixels."""
    from matplotlib.image import imread

    image = imread(path)
    return f"{image.shape} {sha(bytes_of(image))}\n"


def read(path):
    """Read the text of a file."""
    with open(path, encoding="utf-8") as file:
        return file.read()


def fields(found):
    """Write a NamedTuple of arrays as a text."""
    return "".join(
        f"{name} {np.shape(value)} {np.asarray(value).ravel().tolist()} {sha(bytes_of(value))}\n"
        for name, value in found._asdict().items()
    )


def signature(value):
    """Describe a public name: its parameters and its public methods with theirs, without types,
    which name classes inside the package."""

    def parameters(of):
        try:
            found = inspect.signature(of)
        except (TypeError, ValueError):
            return ""
        plain = [
            one.replace(annotation=inspect.Parameter.empty) for one in found.parameters.values()
        ]
        shown = found.replace(parameters=plain, return_annotation=inspect.Signature.empty)
        return re.sub(r" at 0x\w+", "", masked(str(shown)))

    word = "class" if isinstance(value, type) else type(value).__name__  # some have a metaclass
    lines = [f"{word}{parameters(value)}"]
    if isinstance(value, type):
        for name in dir(value):
            home = next((one for one in value.__mro__ if name in vars(one)), object)
            if not name.startswith("_") and home.__module__.startswith("rigidmc"):
                lines.append(f"{name}{parameters(getattr(value, name))}")
    return "\n".join(lines)
