"""One code of docs/coming_from as a process: PYTHON coming_from_process.py FILE.

Writes a line of JSON with the seconds of the import, then one for each task whose name it reads:
its seconds and final states. It needs no rigidmc: the interpreter may have the other program only.
"""

import importlib.util
import json
import os
import sys
import time


def main(file):
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # programs may print

    def answer(**found):
        print(json.dumps(found), file=answers, flush=True)

    began = time.perf_counter()
    spec = importlib.util.spec_from_file_location("code_of_page", file)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ImportError as error:
        answer(missing=str(error))
        return
    answer(seconds=time.perf_counter() - began)
    for line in sys.stdin:
        began = time.perf_counter()
        attitude, omega = getattr(module, line.strip())()
        seconds = time.perf_counter() - began
        answer(seconds=seconds, attitude=attitude.tolist(), omega=omega.tolist())


if __name__ == "__main__":
    main(sys.argv[1])
