"""Functions of the package, compiled for the types of arguments: kernels, and what they inline.

In a few scenes a function is compiled for 3 sets of types. Its bytecode is read once: Numba's
untyped form is copied.
"""

import copy
import functools
from typing import Any

import numba
from numba import njit
from numba.core import compiler, ir
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler_machinery import PassManager
from numba.core.consts import ConstantInference
from numba.core.registry import cpu_target
from numba.core.transforms import canonicalize_cfg
from numba.core.untyped_passes import ExtractByteCode, FixupArgs, TranslateByteCode
from numba.parfors.parfor import ParforDiagnostics

from rigidmc.engine.compiler.pipeline import INLINE, Pipeline


class _Pipeline(Pipeline):
    """The pipeline of a kernel or of an inlined function, with the state that Numba gives it."""

    def __init__(
        self, arguments: tuple[Any, ...], result: Any = None, inlines: bool = True
    ) -> None:
        flags, target = _flags_and_target(inlines)
        diagnostics = ParforDiagnostics()
        self.state = compiler.StateDict(
            typingctx=cpu_target.typing_context, targetctx=target, library=None, pipeline=self,
            args=arguments, return_type=result, flags=flags, locals={}, bc=None, func_id=None,
            func_ir=None, lifted=(), lifted_from=None, typemap=None, calltypes=None,
            type_annotation=None, reload_init=[], parfor_diagnostics=diagnostics,
            metadata={"parfor_diagnostics": diagnostics, "parfors": {}},
            status=compiler._CompileStatus(can_fallback=False),
        )  # fmt: skip

    def compile_extra(self, func: Any) -> Any:
        code = copy_code(_translate(func))
        # Numba names each compiled function by a running number.
        identity = code.func_id = copy.copy(code.func_id)
        identity.unique_id = next(FunctionIdentity._unique_ids)
        identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        self.state.func_id, self.state.func_ir = identity, code
        FixupArgs().run_pass(self.state)
        return self._compile_ir()

    def define_pipelines(self) -> list[PassManager]:
        (passes,) = super().define_pipelines()
        return [_typed(passes)]


def compile_inlined(function: Any, arguments: tuple[Any, ...]) -> Any:
    """Compile an inlined function of the package for arguments of these types.

    It is part of the compilation of a kernel, for which Numba has just read its settings and
    extensions.
    """
    return _Pipeline(arguments).compile_extra(function)


def compile_as_kernel(function: Any, arguments: tuple[Any, ...], result: Any = None) -> Any:
    """Compile a function of the package, with all that it calls, to one optimised LLVM module."""
    numba.config.reload_config()
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    return _Pipeline(arguments, result, inlines=False).compile_extra(function)


@functools.cache
def _flags_and_target(inlines: bool) -> tuple[Any, Any]:
    """Return Numba's flags and context for all inlined functions, or for all kernels."""
    options = njit(**{**INLINE, "forceinline": inlines})(compile_inlined).targetoptions
    cpu_target.options.parse_as_flags(flags := compiler.Flags(), options)
    return flags, compiler._make_subtarget(cpu_target.target_context, flags)


@functools.cache
def _typed(passes: PassManager) -> PassManager:
    """Return the passes after those in `_translate`."""
    rest = copy.copy(passes)
    done = "TranslateByteCode", "FixupArgs", "LeanProcessing"
    rest.passes = [each for each in passes.passes if each[0].__name__ not in done]
    return rest


@functools.cache
def _translate(function: Any) -> Any:
    """Return Numba's form of a function, before types are known."""
    state = compiler.StateDict(func_id=FunctionIdentity.from_function(function))
    for each in (ExtractByteCode, TranslateByteCode):
        each().run_pass(state)
    code = state.func_ir
    if len(code.blocks) > 1:
        code.blocks = canonicalize_cfg(code.blocks)
    return code


def copy_code(code: Any) -> Any:
    """Copy Numba's form of a function, including each part that passes may change."""
    scope = _copy_scope(next(iter(code.blocks.values())).scope)
    values: dict[int, Any] = {}  # {id of an expression: its copy}

    def copy_statement(statement: Any) -> Any:
        made = copy.copy(statement)
        if isinstance(statement, ir.Assign) and isinstance(statement.value, ir.Expr):
            made.value = values[id(statement.value)] = copy.copy(statement.value)
            made.value.__dict__["_kws"] = dict(statement.value._kws)
        return made

    blocks = {}
    for label, block in code.blocks.items():
        blocks[label] = ir.Block(scope, block.loc)
        blocks[label].body = [copy_statement(statement) for statement in block.body]
    made = copy.copy(code)
    made.blocks = blocks
    made._definitions = copy.copy(code._definitions)  # a dictionary that makes lists
    for name, found in code._definitions.items():
        made._definitions[name] = [values.get(id(value), value) for value in found]
    made._consts = ConstantInference(made)
    return made


def _copy_scope(scope: Any) -> Any:
    """Copy the scope of variables, so that new ones may be defined."""
    made = copy.copy(scope)
    made.localvars = copy.copy(scope.localvars)
    made.localvars._con = dict(scope.localvars._con)
    made.redefined = scope.redefined.copy()
    made.var_redefinitions = copy.deepcopy(scope.var_redefinitions)
    return made
