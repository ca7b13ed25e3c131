"""Draw the figures of the paper: `python docs/paper/figures.py [FIGURE ...]`.

Each figure is the picture of one command of rigidmc, run in this folder.
"""

import shlex
import subprocess
import sys
from pathlib import Path

COMMANDS = {
    "flips.png": "rigidmc run dzhanibekov --members 100000 --plot flips.png --force",
    "cost.png": "rigidmc accuracy heavy_top --plot cost.png --force",
}


def main() -> None:
    for name in sys.argv[1:] or COMMANDS:
        print(COMMANDS[name], flush=True)
        _, *options = shlex.split(COMMANDS[name])
        code = "from rigidmc.cli import main; main()"
        folder = Path(__file__).parent
        subprocess.run([sys.executable, "-c", code, *options], cwd=folder, check=True)


if __name__ == "__main__":
    main()
