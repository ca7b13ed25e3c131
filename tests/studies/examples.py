"""The examples of studies as calls and as words of the command line, for tests over all of them."""

import rigidmc as rm
from rigidmc.studies import load_study
from rigidmc.studies.framework.options import options_of


def function_of(name):
    """The example of a study as a call without arguments."""
    study = load_study(name)
    scene, options, settings = study.example
    return lambda: getattr(rm, name)(scene, **options, **settings, threads=1)


def words_of(name, stored=False):
    """The options of the example, of those of members only if they are to be computed."""
    study = load_study(name)
    kept = [one.name for one in options_of(study.options) if not (stored and one.is_new)]
    options = {key: value for key, value in study.example.options.items() if key in kept}
    arguments = [one.name for one in options_of(study.options) if one.is_argument]
    return _words(options if stored else {**options, **study.example.settings}, arguments)


def command_words(name):
    study = load_study(name)
    return [study.command, study.example.scene, *words_of(name)]


def _words(options, arguments=()):
    first = [options[key] for key in arguments if key in options]
    options = {key: value for key, value in options.items() if key not in arguments}
    pairs = ((f"--{key.replace('_', '-')}", value) for key, value in options.items())
    return first + [
        word for key, value in pairs for word in ((key,) if value is True else (key, value))
    ]
