"""The machine code of steps for ARM, made here: packed arithmetic, four members side by side."""

import json
import subprocess
import sys

import pytest

# instructions of a member and step, of LLVM 22 for neoverse-n1
MEASURED = {
    "exact, free": 83.5, "strang, heavy": 309.5,
    "rk4, free": 83.0, "rk4, heavy": 127.75, "rk8, heavy": 807.0,
}  # fmt: skip


@pytest.mark.slow  # 15 s
def test_four_members_side_by_side_suit_arm():
    done = subprocess.run([sys.executable, "-m", "tests.tools.arm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert set(found) == set(MEASURED)
    for name, by_lanes in found.items():
        two, four, eight = (by_lanes[lanes] for lanes in ("2", "4", "8"))
        assert four["instructions"] < 1.1 * MEASURED[name]
        assert four["instructions"] < eight["instructions"] and four["stack"] < eight["stack"]
        assert four["packed"] == eight["packed"] > 0 and four["calls"] == 0
        if name.startswith("rk"):  # its two groups of members are single numbers at two
            assert two["packed"] == 0 and two["instructions"] > four["instructions"]
