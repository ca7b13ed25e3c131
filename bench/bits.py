"""The same bits everywhere: sha256 of results over vector widths and over processors."""

import hashlib
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

from bench import harness

WIDTHS = (1, 2, 4, 8, 16)
PROCESSORS = {
    "this processor": {},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
    "znver2": {"NUMBA_CPU_NAME": "znver2", "NUMBA_CPU_FEATURES": ""},
    "nehalem (no fused multiply-add)": {"NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""},
    "haswell, plain libraries": {
        "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX,-FMA,-FMA4,-AVX512F",
        "NPY_DISABLE_CPU_FEATURES": "all",
    },
}  # fmt: skip
QUICK = ("rk4", "exact", "strang")  # integrators of a quick run; strang takes the bath


def cases(integrators=None, motions=None):
    """[(name, Scene, options of its run)]: free, heavy, driven, in a bath, by every integrator."""
    import rigidmc as rm
    from rigidmc.integrators import accepting

    body = rm.Body.from_moments(
        (rm.uniform(1.0, 1.2), rm.normal(1.4, 0.01), 2.0),
        mass=rm.uniform(1.0, 2.0),
        centre=(0.1, 0.2, rm.normal(0.3, 0.05)),
    )
    scenes = {
        "free": ((), rm.Start(momentum=rm.Sphere(rm.uniform(1.0, 2.0)), attitude="uniform"),
        (rm.Flips(2), "omega_max")),
        "heavy": (
            (rm.Gravity(9.81),),
            rm.Start(omega=rm.Cone(3, rm.uniform(4.0, 6.0), rm.normal(0.1, 0.02)),
            attitude=(rm.uniform(0.0, 6.0), rm.normal(0.5, 0.1), 0.0)),
            (rm.Passage(3, 0.6, "leaves"), "nutation", "energy_mean"),
        ),
        "driven": (
            (rm.Gravity(2.0), rm.ViscousDamping(0.1), rm.SpaceTorque((0.0, 0.2, 0.1)),
            rm.RotatingField((0.1, 0.0, 0.2), (0.3, 0.0, 0.1), 1.5)),
            rm.Start(omega=(rm.normal(0.0, 1.0), 0.5, 1.0), attitude="uniform"),
            ("omega_max",),
        ),
        "in a bath": (
            (rm.Gravity(1.0), rm.Bath(0.5, rm.uniform(0.5, 1.0))),
            rm.Start(momentum=rm.GibbsMomentum(1.0), attitude="uniform"),
            ("energy_variance",),
        ),
    }  # fmt: skip
    rows = []
    for word, (effects, start, watched) in scenes.items():
        if motions is not None and word not in motions:
            continue
        scene = rm.Scene(body, effects, start).with_run(
            t_end=2.0,
            every=0.5,
            members=37,
            seed=5,
            save=("attitude", "momentum", "energy", *watched),
        )
        for name in accepting(effects):
            if name != "closed" and (integrators is None or name in integrators):
                # which solves for less than 0.5 rad
                rows.append(
                    (word, scene, {"integrator": name, "dt": 0.02 if name == "midpoint" else 0.05})
                )
        if effects and word != "in a bath":
            rows.append((word, scene, {"integrator": "rk4", "turn": 0.1}))
        if word == "heavy":
            rows.append((word, scene, {"integrator": "rk4", "dt": 0.05, "dtype": "float32"}))
            rows.append(
                (
                    word,
                    scene,
                    {
                        "integrator": "strang",
                        "dt": 0.05,
                        "save": (*scene.run.save, "work", "megno"),
                    },
                )
            )
    return rows


def sums(widths, integrators=None, motions=None):
    """{case: [sha256 of its result for each width]}."""
    import rigidmc as rm
    from rigidmc.engine import program

    lanes_for, digests = program.lanes_for, {}
    try:
        for word, scene, options in cases(integrators, motions):
            label = (
                f"{word}, "
                f"{', '.join(str(v) for v in options.values() if isinstance(v, (str, float)))}"
            )
            label += (
                " steps of their own"
                if "turn" in options
                else ", works and a neighbour"
                if "save" in options
                else ""
            )
            for width in widths:
                program.lanes_for = (lambda dtype, width=width: width) if width else lanes_for
                result = rm.simulate(scene, threads=1, checks=False, **options)
                parts = [
                    np.ascontiguousarray(result[name].values).tobytes()
                    for name in sorted(result.data_vars)
                ]
                digests.setdefault(label, []).append(hashlib.sha256(b"".join(parts)).hexdigest())
    finally:
        program.lanes_for = lanes_for
    return digests


def elsewhere(processor, widths, integrators=None, motions=None):
    """`sums` in a process with code for another processor and a cache of its own."""
    environment = {**os.environ, **PROCESSORS[processor]}
    if environment.get("NPY_DISABLE_CPU_FEATURES") == "all":
        from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(
            name for name in __cpu_dispatch__ if __cpu_features__.get(name)
        )
    code = (
        "import json, sys, warnings; warnings.simplefilter('ignore'); from bench.bits "
        "import sums; print(json.dumps(sums(*json.load(sys.stdin))))"
    )
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as cache:
        done = subprocess.run(
            [sys.executable, "-c", code],
            input=json.dumps([widths, integrators, motions]),
            env={**environment, "RIGIDMC_CACHE_DIR": cache},
            capture_output=True,
            text=True,
        )
    if done.returncode:
        raise RuntimeError(f"{processor}: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def run(quick):
    """All rows of the bench."""
    some = QUICK if quick else None
    digests = {"this processor": elsewhere("this processor", WIDTHS, some)}
    for processor in list(PROCESSORS)[1:]:
        digests[processor] = elsewhere(processor, (0,), some)  # the width that suits the processor
    rows = [
        {"kind": "bits", "processor": word, "case": case, "sums": each}
        for word, by_case in digests.items()
        for case, each in by_case.items()
    ]
    same = sum(
        len({one for by_case in digests.values() for one in by_case[case]}) == 1
        for case in digests["this processor"]
    )
    return [
        *rows,
        harness.target(
            "cases whose results are the same everywhere", len(digests["this processor"]), same, ""
        ),
    ]


def report(rows):
    """Print the results."""
    table = {}
    for row in rows:
        if row["kind"] == "bits":
            table.setdefault(row["case"], []).extend(row["sums"])
    head = ["", *(f"x{width}" for width in WIDTHS), *list(PROCESSORS)[1:]]
    harness.table(
        "sha256 of results, members side by side and processors",
        head,
        [[case, *(one[:6] for one in each)] for case, each in table.items()],
    )
    harness.report_targets(rows)
