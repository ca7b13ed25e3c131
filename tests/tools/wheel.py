"""Build sdist and wheel and try every command of both: python tests/tools/wheel.py [--keep DIR].

Each is installed in a fresh virtual environment and used in an empty folder, so that a command
which needs a file of the repository fails. Needs the package `build`; takes 10 minutes, mostly for
pip and the compiler.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# In this order: later commands read what earlier ones write. All of them must exit with 0.
COMMANDS = """
doctor
scenes
scenes heavy_top
effects
effects gravity
observables
integrators
integrators rk4
check dzhanibekov
show dzhanibekov --members 64
body dzhanibekov
exact dzhanibekov --members 4 --at 1
run dzhanibekov --members 64 --t-end 2 --every 1 --save omega,attitude -o result.nc
summary result.nc
rerun result.nc --member 3 -o member.nc
run dzhanibekov --members 64 --t-end 2 --shards 0:1 -o run/
run dzhanibekov --members 64 --t-end 2 --shards 0:1 -o part/
merge run part
resume run
status run
extend run --members 128
verify run
consolidate run -o whole.nc
map list
map tennis_racket --x start.omega.1=0.1:1 --y start.omega.3=0.1:1 --of mean(energy_drift_max) \
--resolution 4 --members 1 --t-end 1 -o map.nc
accuracy dzhanibekov --integrators rk4,strang --tolerances 1e-3 --members 16 --set run.t_end=1
stress --quick --group H13 --integrator exact
warm dzhanibekov
""".replace("\\\n", "")

PICTURES = """
plot result.nc -o result.png
animate result.nc --member 0 --seconds 0.2 --fps 10 -o member.gif
"""


def said(words, folder, environment=None):
    """The output of a command; an error with that output if it fails."""
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8"
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}: exit code {done.returncode}\n"
                         f"{done.stdout}\n{done.stderr}")  # fmt: skip
    return done.stdout


def build(folder):
    """(wheel, sdist) of the repository."""
    said([sys.executable, "-m", "build", "--outdir", folder, ROOT], ROOT)
    (wheel,), (sdist,) = Path(folder).glob("*.whl"), Path(folder).glob("*.tar.gz")
    return wheel, sdist


def install(package, folder):
    """The folder of programs of a new virtual environment with a package in it."""
    said([sys.executable, "-m", "venv", folder], ROOT)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    said([programs / "python", "-m", "pip", "install", "--quiet", package], folder)
    return programs


def try_commands(programs, commands, folder, cache):
    """Run each command; return the names of those tried."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    environment |= {"RIGIDMC_CACHE_DIR": str(cache), "PYTHONUTF8": "1"}
    lines = commands.strip().splitlines()
    for line in lines:
        print(f"rigidmc {line}", flush=True)
        said([programs / "rigidmc", *line.split()], folder, environment)
    return {line.split()[0] for line in lines}


def every_command(programs, folder):
    """The names of all commands of the installed package; each must print its help."""
    code = "import typer, rigidmc.cli as c; print(*typer.main.get_command(c.app).commands)"
    names = said([programs / "python", "-c", code], folder).split()
    for name in names:
        said([programs / "rigidmc", name, "--help"], folder)
    return set(names)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", metavar="DIR", help="leave wheel and sdist in this folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        for package in build(Path(options.keep or scratch / "dist").resolve()):
            kind = "wheel" if package.suffix == ".whl" else "sdist"
            print(package.name, flush=True)
            programs = install(package, scratch / kind)
            folder = scratch / f"{kind}-work"
            folder.mkdir()
            tried = try_commands(programs, COMMANDS, folder, scratch / "cache")
            said([programs / "python", "-m", "pip", "install", "--quiet", "matplotlib"], folder)
            tried |= try_commands(programs, PICTURES, folder, scratch / "cache")
            untried = every_command(programs, folder) - tried
            if untried:
                raise SystemExit(f"not tried: {', '.join(sorted(untried))}")
    print("every command works without the repository")


if __name__ == "__main__":
    main()
