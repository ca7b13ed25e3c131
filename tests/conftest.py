"""Settings of all tests: which run first, what hypothesis draws, one compiling process a worker."""

import functools
import gc
import os
from collections import Counter

import pytest
import typer.main
import typer.testing
from hypothesis import HealthCheck, settings

from rigidmc.engine import compile_helper
from rigidmc.engine.compiler import kernels

# No second process compiles: the workers of pytest use all cores (4 min instead of 7).
compile_helper.threads_available = lambda: 1


def _compiled(dispatcher, signature, compiled=kernels._compile):
    """The code of a piece. What Numba keeps of it is looked through for garbage once and never
    again: 1.8 s and not 3.1 of the 33 s that tests/physics/effects/test_user.py takes."""
    address = compiled(dispatcher, signature)
    gc.collect(0)
    gc.freeze()
    return address


kernels._compile = _compiled

# `CliRunner` makes all commands anew in each call, 25 of the 50 ms that `rigidmc show` takes.
typer.testing._get_command = functools.cache(typer.main.get_command)

# Files that compile nothing and fail within seconds if a step or Euler's equations are wrong.
FIRST = ("tests/physics/integrators/test_steps.py", "tests/physics/dynamics/test_euler.py")

# Files that take 10 to 70 s of a processor, the longest first: at the end one worker would wait for
# them.
LONG = (
    "tests/runs/test_resume.py",
    "tests/engine/test_cuda.py",
    "tests/physics/observables/test_monitoring.py",
    "tests/engine/test_bits.py",
    "tests/views/test_pictures.py",
    "tests/studies/test_framework.py",
    "tests/physics/integrators/test_precision.py",
    "tests/engine/kernel/test_last_interval.py",
    "tests/whole/test_docstrings.py",
    "tests/whole/test_hostile.py",
    "tests/results/test_export.py",
    "tests/physics/observables/test_chaos.py",
    "tests/studies/test_rare.py",
    "tests/physics/effects/test_user.py",
    "tests/planning/test_choose.py",
    "tests/engine/compiler/test_cache_of_user_parts.py",
    "tests/whole/test_random_scenes.py",
    "tests/whole/test_properties.py",
    "tests/cli/test_commands.py",
    "tests/results/test_border.py",
    "tests/physics/effects/test_work.py",
    "tests/physics/effects/test_dissipation.py",
    "tests/studies/test_multilevel.py",
    "tests/engine/compiler/test_cache.py",
    "tests/physics/integrators/test_integrators.py",
    "tests/physics/integrators/test_published.py",
    "tests/physics/observables/test_angles.py",
    "tests/studies/test_stored_maps.py",
    "tests/engine/test_compile_time.py",
    "tests/whole/test_independence_of_saves.py",
    "tests/physics/observables/test_dwell.py",
    "tests/physics/observables/test_directions.py",
    "tests/files/test_outputs.py",
    "tests/studies/test_adaptive_maps.py",
    "tests/engine/compiler/test_code_size.py",
    "tests/studies/test_sections.py",
    "tests/studies/test_sensitivity.py",
    "tests/views/test_viewer.py",
    "tests/whole/test_new_parts.py",
    "tests/cli/test_text_input.py",
    "tests/scene/test_satellites.py",
    "tests/planning/test_closed_form.py",
    "tests/statistics/test_censored.py",
    "tests/files/test_helpers.py",
)

# The same examples every time; HYPOTHESIS_PROFILE=nightly draws many more, and new ones.
settings.register_profile("reproducible", derandomize=True, deadline=None)
settings.register_profile(
    "nightly",
    max_examples=10_000,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))


def pytest_collection_finish():
    """Let no search for garbage look through tests and modules: it took 5 % of the processor."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


def pytest_collection_modifyitems(items):
    """FIRST, then LONG, then the files with the most tests, so that workers end together."""
    sizes = Counter(item.path for item in items)
    order = FIRST + LONG

    def place(item):
        name = item.path.relative_to(item.config.rootpath).as_posix()
        return order.index(name) if name in order else len(order), -sizes[item.path]

    items.sort(key=place)
    # Tests of limits, sick starts and random scenes flag members on purpose. The warning itself is
    # tested by pytest.warns, to which this does not apply.
    flagged = pytest.mark.filterwarnings(
        "ignore:.* flagged .* keeps? the last good state:rigidmc.errors.SceneWarning"
    )
    for item in items:
        item.add_marker(flagged)
