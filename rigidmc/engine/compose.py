"""From a tuple of effects to one straight-line function: the one clever file.

Physics is written as plain functions and as methods of NamedTuples. Here they become callable from compiled code: a plain
function through `overload` with itself as the implementation, a method through `overload` on the TYPE of its NamedTuple.
Tuples of effects are unrolled by recursion on their type, so a kernel holds what a scene lists and nothing else, and
Numba's disk cache works, since no function is ever an argument.
"""

import inspect
import sys

import numpy as np
from numba.core import compiler, compiler_machinery, ir, types
from numba.core.errors import NumbaError  # noqa: F401  (for those who call)
from numba.core.typed_passes import NativeLowering
from numba.core.untyped_passes import IRProcessing
from numba.extending import intrinsic, overload

import rigidmc.integrators.verbs
import rigidmc.observables.verbs  # noqa: F401  (imported so that METHODS is complete)
from rigidmc.dynamics import euler, free_flow, principal, so3
from rigidmc.dynamics.methods import METHODS, arguments
from rigidmc.effects import EFFECTS, flows, verbs
from rigidmc.engine.fused import FusingLowering
from rigidmc.integrators import drifts, lie, midpoint, rk4, rk8, splitting
from rigidmc.observables import SUMMARIES, statistics

# "nsz" lets an absent effect's +0.0 vanish (12 packed adds a step without it). No other flag: "nnan" or "ninf" would delete the check for
# non-finite members, "contract" would let bits depend on what is compiled beside them (see `rigidmc.engine.fused`).
FLAGS = {"error_model": "numpy", "fastmath": {"nsz"}}


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=False)
class _Precision(compiler_machinery.FunctionPass):
    """Constants take the precision of the arguments: 0.5 * x is float32 where x is, which Numba alone would make float64.

    A module may say in SINGLE what its named constants are in float32.
    """

    _name = "rigidmc_precision"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        kinds = {kind for a in state.args for kind in _numbers(a)}
        if types.float32 not in kinds or types.float64 in kinds:
            return False
        named = state.func_ir.func_id.func.__globals__.get("SINGLE", {})
        for block in state.func_ir.blocks.values():
            for assign in block.find_insts(ir.Assign):
                if isinstance(assign.value, (ir.Const, ir.Global, ir.FreeVar)):
                    value = named.get(getattr(assign.value, "name", None), assign.value.value)
                    if (made := as_single(value)) is not value:
                        assign.value = ir.Const(made, assign.loc)
        return True


def _numbers(kind):
    """The types of the numbers in a type, those of tuples included."""
    return [n for k in kind for n in _numbers(k)] if isinstance(kind, types.BaseTuple) else [kind]


def as_single(value):
    """Numbers, and tuples of them, in float32."""
    if isinstance(value, float):
        return np.float32(value)
    if not isinstance(value, tuple) or not value:
        return value
    made = map(as_single, value)
    return type(value)(*made) if hasattr(value, "_fields") else tuple(made)


class Pipeline(compiler.CompilerBase):
    """Numba's own pipeline with `_Precision`, and with `FusingLowering` in the place of its lowering."""

    def define_pipelines(self):
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Precision, IRProcessing)
        passes.passes = [(FusingLowering if kind is NativeLowering else kind, what) for kind, what in passes.passes]
        passes.finalize()
        return [passes]


FLAGS["pipeline_class"] = Pipeline
INLINE = {**FLAGS, "forceinline": True, "no_cfunc_wrapper": True}  # without forced inlining no lane loop vectorises

_known = set()


def reason(error):
    """The innermost cause of a failed compilation, with the place, on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    causes = [
        line
        for line in lines
        if not line.startswith(
            ("During", "Failed", "There are", "- ", ">>>", "Overload", "With argument", "Rejected", "File", "def ", "<source")
        )
    ]
    places = [line for line in lines if line.startswith("File ")]
    return (causes[-1] if causes else lines[0])[:200] + (f" ({places[-1].rstrip(':')})" if places else "")


def inline(function):
    """Let compiled code call a plain Python function, inlined."""
    if function not in _known:
        _known.add(function)
        overload(function, jit_options=INLINE, strict=False)(lambda *args: function)
    return function


def compile_method(call):
    """Let compiled code call a generic function of `rigidmc.dynamics.methods`."""
    name, default, available = call.__name__, inline(call.default), call.available

    @overload(call, jit_options=INLINE, strict=False)
    def resolve(part, *values):
        function = getattr(part.instance_class, name, None)
        if function is None:
            return default
        inline(function)
        at = [available.index(argument) for argument in arguments(function)]
        a, b, c, d, e, f, g = at + [0] * (7 - len(at))
        return (
            lambda part, *v: function(part),
            lambda part, *v: function(part, v[a]),
            lambda part, *v: function(part, v[a], v[b]),
            lambda part, *v: function(part, v[a], v[b], v[c]),
            lambda part, *v: function(part, v[a], v[b], v[c], v[d]),
            lambda part, *v: function(part, v[a], v[b], v[c], v[d], v[e]),
            lambda part, *v: function(part, v[a], v[b], v[c], v[d], v[e], v[f]),
            lambda part, *v: function(part, v[a], v[b], v[c], v[d], v[e], v[f], v[g]),
        )[len(at)]


@intrinsic(prefer_literal=False)
def _read(typing_context, part, work, row, lane, stride):
    """A NamedTuple of the class of `part` from work[(row + i)*stride + lane], i = 0, 1, ..., in the precision of work."""
    kinds = [types.UniTuple(work.dtype, len(kind)) if isinstance(kind, types.BaseTuple) else work.dtype for kind in part]
    made: types.Type = part
    if kinds:
        alike = all(kind == kinds[0] for kind in kinds)
        made = (
            types.NamedUniTuple(kinds[0], len(kinds), part.instance_class)
            if alike
            else types.NamedTuple(kinds, part.instance_class)
        )
    signature = made(part, work, row, lane, stride)

    def generate(context, builder, signature, values):
        array = context.make_array(signature.args[1])(context, builder, values[1])
        row, lane, stride = values[2:]
        at = iter(range(_rows_of(part)))

        def number():
            index = builder.add(builder.mul(builder.add(row, row.type(next(at))), stride), lane)
            return builder.load(builder.gep(array.data, [index]))

        fields = [
            context.make_tuple(builder, kind, [number() for _ in kind]) if isinstance(kind, types.BaseTuple) else number()
            for kind in kinds
        ]
        return context.make_tuple(builder, made, fields)

    return signature, generate


def _rows_of(kind):
    """How many numbers a NamedTuple's type has, those of vectors counted one by one."""
    return sum(len(k) if isinstance(k, types.BaseTuple) else 1 for k in kind)


def rows_of(part):
    """How many rows of a workspace a NamedTuple takes."""
    return sum(len(x) if isinstance(x, tuple) else 1 for x in part)


@overload(rows_of, jit_options=INLINE)
def _compiled_rows_of(part):
    number = _rows_of(part)
    return lambda part: number


def read(part, work, row, lane, stride):
    """A NamedTuple of the type of `part` from the rows of a workspace."""
    rows = iter(range(row, row + rows_of(part)))
    fields = [
        tuple(work[next(rows) * stride + lane] for _ in x) if isinstance(x, tuple) else work[next(rows) * stride + lane]
        for x in part
    ]
    return type(part)(*fields)


@overload(read, jit_options=INLINE)
def _compiled_read(part, work, row, lane, stride):
    if isinstance(part, types.BaseAnonymousTuple) or not hasattr(part, "instance_class"):
        return None
    return lambda part, work, row, lane, stride: _read(part, work, row, lane, stride)


def read_all(parts, work, row, lane, stride):
    """A tuple of NamedTuples of the types of `parts` from consecutive rows."""
    if len(parts) == 0:
        return ()
    first = read(parts[0], work, row, lane, stride)
    return (first,) + read_all(parts[1:], work, row + rows_of(parts[0]), lane, stride)


def all_rows(parts):
    """How many rows some NamedTuples take."""
    if len(parts) == 0:
        return 0
    return rows_of(parts[0]) + all_rows(parts[1:])


def inline_all(module):
    """Let compiled code call every plain function of a module."""
    for function in list(vars(module).values()):
        if inspect.isfunction(function) and function.__module__ == module.__name__ and function not in METHODS:
            inline(function)


for _module in (so3, euler, free_flow, principal, verbs, drifts, lie, midpoint, rk4, rk8, splitting, flows, statistics):
    inline_all(_module)
for _kind in (*EFFECTS.values(), *SUMMARIES.values()):
    inline_all(sys.modules[_kind.__module__])
inline(read_all)
inline(all_rows)
for _call in METHODS:
    compile_method(_call)
