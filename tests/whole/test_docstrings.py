"""Every public docstring is numpydoc: complete by `numpydoc.validate`, with examples that run."""

import doctest
import inspect
import warnings
from typing import NamedTuple

import numpy as np
import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate

import rigidmc as rm
from rigidmc.views.accessor import Rigid

# Left out of numpydoc's checks:
# - GL01, GL02: where the quotes stand; ruff formats the files
# - SS06: a summary may take two lines
# - ES01, SA01: an extended summary and See Also are there where they help
# - PR08, PR09, RT04, RT05: a meaning is a noun phrase, as in --help: no capital, no full stop
# - GL09, GL10, SA02 to SA04: nothing of what they check is in use
CHECKS = (
    *("GL03", "GL05", "GL06", "GL07", "GL08", "SS01", "SS02", "SS03", "SS04", "SS05"),
    *("PR01", "PR02", "PR03", "PR04", "PR05", "PR06", "PR07", "PR10"),
    *("RT01", "RT02", "RT03", "YD01", "EX01"),
)
OF_CONSTRUCTOR = ("PR01", "PR02", "PR03")


def public():
    """{name: class, function or property} of all that a user may call."""
    found = {name: getattr(rm, name) for name in rm.__all__}
    for kind in (rm.Body, rm.Scene, rm.Start, rm.Run, Rigid):
        for base in kind.__mro__:
            if base.__module__.startswith("rigidmc."):
                for word, value in vars(base).items():
                    whole = getattr(value, "__func__", value)
                    if not word.startswith("_") and (
                        inspect.isfunction(whole) or isinstance(whole, property)
                    ):
                        found.setdefault(f"{kind.__name__}.{word}", whole)
    return found | {"Rigid": Rigid}


PUBLIC = public()


def faults(thing):
    """The complaints of numpydoc about a docstring, of those that count."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = validate(get_doc_object(thing))["errors"]
    built = isinstance(thing, type) and "__init__" not in vars(thing)
    # an error takes its constructor from the error that it is a kind of, which documents it
    inherited = built and issubclass(thing, Exception)
    skipped = OF_CONSTRUCTOR if inherited else ()
    return [f"{code} {text}" for code, text in found if code in CHECKS and code not in skipped]


def examples(name):
    """The doctest of a public name; as in the documentation, rm and np are imported."""
    text = inspect.cleandoc(PUBLIC[name].__doc__)
    names = {"rm": rm, "np": np}
    return doctest.DocTestParser().get_doctest(text, names, name, None, None)


def failures(test):
    """What the doctest reports, "" if all its examples print what they promise."""
    said = []
    doctest.DocTestRunner().run(test, out=said.append)
    return "".join(said)


@pytest.mark.parametrize("name", PUBLIC)
def test_docstring_is_complete(name):
    assert not faults(PUBLIC[name])


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test = examples(name)
    assert test.examples and not failures(test)


def test_all_public_names_are_checked():
    methods = {"Body.from_mesh", "Body.tensor", "Scene.load", "Scene.with_run", "Start.sample_spin"}
    assert {*rm.__all__, *methods, "Rigid", "Rigid.energy"} <= set(PUBLIC)


class Broken(NamedTuple):
    """An effect without parameters in its docstring

    loss : in the style of an earlier version

    Examples
    --------
    >>> 1 + 1
    3
    """

    loss: float

    def torque(self, q):
        """Torques in the body."""
        return q


def test_a_broken_docstring_fails(monkeypatch):
    codes = [fault.split()[0] for fault in faults(Broken)]
    assert codes == ["SS03", "PR01"]
    codes = [fault.split()[0] for fault in faults(Broken.torque)]
    assert codes == ["SS05", "PR01", "RT01", "EX01"]
    monkeypatch.setitem(PUBLIC, "Broken", Broken)
    assert "Expected:\n    3\nGot:\n    2" in failures(examples("Broken"))
