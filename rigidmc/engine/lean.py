"""Numba's own steps of a compilation without what the package's functions do not need.

Compilation is faster, and the code is the same.
"""

import operator
from typing import Any

from numba.core import errors, ir, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NopythonTypeInference
from numba.core.typeinfer import TypeInferer

_POWERS = operator.pow, operator.ipow  # of a constant exponent they have code of its own
_signatures: dict[Any, Any] = {}  # of calls, by the types of function and arguments


def _signature(context: Any, function: Any, arguments: Any) -> Any:
    """The signature of a call, found once: Numba does so two or three times in each function."""
    key = function, tuple(arguments)
    if key not in _signatures:
        _signatures[key] = context.resolve_function_type(function, key[1], {})
    return _signatures[key]


class LeanPasses(PassManager):
    """Runs passes without events, and without checks of functions between them.

    The passes that need the lifetimes of variables find them out by themselves.
    """

    @global_compiler_lock
    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        pss.run_initialization(internal_state)
        pss.run_pass(internal_state)
        pss.run_finalizer(internal_state)


class _Inference(TypeInferer):
    """Finds the signature of a call once for all functions."""

    def resolve_call(self, fnty: Any, pos_args: Any, kw_args: Any) -> Any:
        if type(fnty) is types.Function and not kw_args:
            return _signature(self.context, fnty, pos_args)
        return super().resolve_call(fnty, pos_args, kw_args)


class _Unfiltered(errors.WarningsFixer):  # type: ignore[misc, name-defined]
    """Numba collects the warnings of each call by itself; the package's calls have none."""

    def catch_warnings(self, filename: Any = None, lineno: Any = None) -> Any:
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *error: object) -> None:
        pass


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanInference(NopythonTypeInference):
    """Numba's own inference of types, for functions without arrays and without warnings."""

    _name = "rigidmc_lean_inference"

    def run_pass(self, state: Any) -> bool:
        function, context = state.func_ir, state.typingctx
        infer = _Inference(context, function, _Unfiltered(errors.NumbaWarning))
        frame = context.callstack.register(state.targetctx.target, infer, state.func_id, state.args)
        with frame:
            for i, (name, kind) in enumerate(zip(function.arg_names, state.args, strict=True)):
                infer.seed_argument(name, i, kind)
            if state.return_type is not None:
                infer.seed_return(state.return_type)
            infer.build_constraint()
            state.typing_errors = infer.propagate()
            state.typemap, state.return_type, state.calltypes = infer.unify()
        return True


class LeanLower(Lower):
    """Numba's own lowering of a function, without texts of instructions for messages of errors."""

    def lower_block(self, block: Any) -> None:
        self.pre_block(block)
        for instruction in block.body:
            self.loc = instruction.loc
            self.lower_inst(instruction)
        self.post_block(block)

    def lower_inst(self, inst: Any) -> None:
        if isinstance(inst, ir.Assign):
            value = self.lower_assign(self.typeof(inst.target.name), inst)
            argument = inst.value.index + 1 if isinstance(inst.value, ir.Arg) else None
            self.storevar(value, inst.target.name, argidx=argument)
        elif isinstance(inst, ir.Del):
            self.delvar(inst.value)
        else:
            super().lower_inst(inst)

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Numba tries first whether a constant operand has code of its own: powers alone do."""
        if op in _POWERS:
            return super().lower_binop(resty, expr, op)
        signature, builder = self.fndesc.calltypes[expr], self.builder
        operands = [
            self.context.cast(builder, self.loadvar(x.name), self.typeof(x.name), kind)
            for x, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        typing = self.context.typing_context
        kind = typing.resolve_value_type(op)  # since the inference it may know more types
        called = _signature(typing, kind, signature.args)
        result = self.context.get_function(kind, called)(builder, operands)
        return self.context.cast(builder, result, signature.return_type, resty)
