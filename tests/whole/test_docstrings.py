"""Every public docstring is numpydoc: complete by `numpydoc.validate`, with examples that run."""

import doctest
import inspect
import re
import warnings
from importlib import import_module

import numpy as np
import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate

import rigidmc as rm
from rigidmc.views.accessor import Rigid

# Left out of numpydoc's checks:
# - GL01, GL02: where the quotes stand; ruff formats the files
# - SS05: a summary may be a noun in the plural
# - SS06: a summary may take two lines
# - ES01, SA01: an extended summary and See Also are there where they help
# - PR08, PR09, RT04, RT05: a meaning is a noun phrase, as in --help: no capital, no full stop
# - GL09, GL10, SA02 to SA04: nothing of what they check is in use
CHECKS = (
    *("GL03", "GL05", "GL06", "GL07", "GL08", "SS01", "SS02", "SS03", "SS04"),
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


@pytest.mark.parametrize("name", PUBLIC)
def test_docstring_is_complete(name):
    assert not faults(PUBLIC[name])


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test, said = examples(name), []
    assert test.examples
    doctest.DocTestRunner().run(test, out=said.append)
    assert not said, "".join(said)


