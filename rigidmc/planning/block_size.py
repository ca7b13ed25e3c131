"""How many members a block has: enough to fill a thread or a graphics processor, and few enough for
the memory that their saves take on the way to a file."""

import math
from typing import TYPE_CHECKING

from rigidmc.engine.kernel.layout import LANES, whole_lanes

if TYPE_CHECKING:
    from rigidmc.planning.plan import Plan

# Members of a block: their 30 to 40 rows are 1 MB, and a call on them takes 10 ms or more. With
# 4096 all rows would compete for one place in the cache, and a block would begin and end in 64 ns a
# member, not 47.
BLOCK = 4064
SLAB = 32 * 2**20  # bytes of saved values that a block may hold on its way to a file
# The same on graphics processors, one of which moves 50,000 members at once, as their registers
# allow: a block is ten such waves, of which the last may be short.
DEVICE_BLOCK, DEVICE_SLAB = 2**19, 2**27
WAVE = 2**16  # members that take as long there as one


def block_of(plan: "Plan", threads: int, streaming: bool) -> int:
    """Members of a block: few enough to occupy all threads, and fewer on their way to a file."""
    blocks = (1 if plan.member_steps else 4) * threads
    if plan.device != "cpu":
        blocks = max(plan.movers(threads), min(blocks, plan.members // WAVE))
        block = min(DEVICE_BLOCK, whole_lanes(math.ceil(plan.members / blocks)))
        # in memory most saves are written where they stay
        return min(block, fitting(plan, DEVICE_SLAB if streaming else 16 * DEVICE_SLAB))
    block = min(BLOCK, whole_lanes(math.ceil(plan.members / blocks)))
    return min(block, fitting(plan, SLAB)) if streaming else block


def fitting(plan: "Plan", slab: int) -> int:
    """Members whose saved values take about `slab` bytes."""
    values = 8 * max(1, plan.values) * plan.times.size
    return max(LANES, slab // values // LANES * LANES)


def block_of_shard(plan: "Plan", shard: int) -> int:
    """Members of a block on graphics processors that divides a shard: all of it if they fit."""
    most = min(2 * DEVICE_BLOCK, fitting(plan, DEVICE_SLAB))
    return shard if shard <= most else block_in(shard, most)


def block_in(shard: int, most: int) -> int:
    """Members of a block that divides a shard's, at most `most`."""
    return LANES * max(n for n in range(1, most // LANES + 1) if shard % (LANES * n) == 0)
