"""The compilation pipeline: functions are inlined into their kernel and optimised there, once.

Numba compiles, optimises and links each function by itself, and then the kernel again. Here an
inlined function stops at LLVM code (`InlineLibrary`), and a kernel collects the functions it calls
(`KernelLibrary`). Passes of Numba that the package's functions do not need are skipped, and
signatures of calls are cached: the code is the same, and is ready sooner. `fuse` is the last step
of lowering, before anything is inlined.
"""

import contextlib
import operator
from collections import Counter
from collections.abc import Iterator
from typing import Any

import llvmlite.binding as llvm
from numba._dynfunc import make_function
from numba.core import compiler, errors, ir, types
from numba.core.cgutils import alloca_once, normalize_ir_text
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering, NopythonTypeInference
from numba.core.typeinfer import TypeInferer

from rigidmc.engine.compiler.fma import fuse
from rigidmc.engine.compiler.lean_passes import LEAN, UNUSED_PASSES, LeanPasses
from rigidmc.engine.machine import vector_registers

_POWERS = operator.pow, operator.ipow  # with special code for a constant exponent
_signatures: dict[Any, Any] = {}  # of calls, by the types of function and arguments


def _signature(context: Any, function: Any, arguments: Any) -> Any:
    """Return the signature of a call, cached: Numba looks it up several times per function."""
    key = function._code, *[argument._code for argument in arguments]
    if key not in _signatures:
        _signatures[key] = context.resolve_function_type(function, tuple(arguments), {})
    return _signatures[key]


class _Inference(TypeInferer):
    """Type inference that resolves the signature of a call once for all functions."""

    def resolve_call(self, fnty: Any, pos_args: Any, kw_args: Any) -> Any:
        if type(fnty) is types.Function and not kw_args:
            return _signature(self.context, fnty, pos_args)
        return super().resolve_call(fnty, pos_args, kw_args)

    def propagate(self, raise_errors: bool = True) -> Any:
        # In one block each type follows from earlier ones: Numba would go through all twice to see
        # that nothing changes.
        if len(self.blocks) > 1 or self.constraints.propagate(self):
            return super().propagate(raise_errors)
        return None


class _Unfiltered(errors.WarningsFixer):  # type: ignore[misc, name-defined]
    """A warnings filter that does nothing: Numba collects warnings per call, but here are none."""

    def catch_warnings(self, filename: Any = None, lineno: Any = None) -> Any:
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *error: object) -> None:
        pass


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanInference(NopythonTypeInference):
    """Numba's own inference of types, for functions without arrays or warnings."""

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
    """Numba's own lowering of a function, without texts of instructions for error messages.

    No variable is deleted, and there is no `try`.
    """

    def _find_singly_assigned_variable(self) -> None:
        if len(self.func_ir.blocks) > 1:
            super()._find_singly_assigned_variable()
            return
        (block,) = self.func_ir.blocks.values()
        count = Counter(each.target.name for each in block.body if isinstance(each, ir.Assign))
        self._singly_assigned_vars = {name for name, times in count.items() if times == 1}
        self._blk_local_varmap: dict[str, Any] = {}

    def pre_block(self, block: Any) -> None:
        self._cur_ir_block = block

    def post_block(self, block: Any) -> None:
        pass

    def lower_block(self, block: Any) -> None:
        self.pre_block(block)
        for instruction in block.body:
            self.loc = instruction.loc
            self.lower_inst(instruction)
        self.post_block(block)

    def lower_inst(self, inst: Any) -> None:
        # Nearly all instructions are assignments.
        if isinstance(inst, ir.Assign):
            value = self.lower_assign(self.typeof(inst.target.name), inst)
            argument = inst.value.index + 1 if isinstance(inst.value, ir.Arg) else None
            self.storevar(value, inst.target.name, argidx=argument)
        else:
            super().lower_inst(inst)

    def emit_environment_object(self) -> None:
        pass  # Python never calls the function

    def alloca_lltype(self, name: str, lltype: Any, datamodel: Any = None) -> Any:
        # Numba computes the size of each variable for a debugger.
        return alloca_once(self.builder, lltype, name=name, zfill=False)

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Store a value; Numba would first load the old value, to count its references."""
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self._alloca_var(name, self.typeof(name))
            self.builder.store(value, self.getvar(name))

    def lower_call(self, resty: Any, expr: Any) -> Any:
        """Lower a call; Numba would make three texts of each call for debugging."""
        signature, kind = self.fndesc.calltypes[expr], self.typeof(expr.func.name)
        result = signature.return_type
        if type(kind) is not types.Function or isinstance(result, types.Phantom) or expr.target:
            return super().lower_call(resty, expr)
        given = self.fold_call_args(kind, signature, expr.args, expr.vararg, expr.kws)
        value = self.context.get_function(kind, signature)(self.builder, given, self.loc)
        if value is None:
            value = self.context.get_dummy_value()
        return self.context.cast(self.builder, value, result, resty)

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Lower an operator; of constant operands, only exponents have special code."""
        if op in _POWERS:
            return super().lower_binop(resty, expr, op)
        signature, builder = self.fndesc.calltypes[expr], self.builder
        operands = [
            self.context.cast(builder, self.loadvar(x.name), self.typeof(x.name), kind)
            for x, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        typing = self.context.typing_context
        kind = typing.resolve_value_type(op)  # it may know more types since the inference
        called = _signature(typing, kind, signature.args)
        result = self.context.get_function(kind, called)(builder, operands)
        return self.context.cast(builder, result, signature.return_type, resty)


LINE = (
    64  # bytes of a cache line and of the widest vectors: across two lines they need two accesses
)


class Fusing:
    """The lowering of a function, then `fuse`."""

    module: Any

    def lower_normal_function(self, fndesc: Any) -> None:
        super().lower_normal_function(fndesc)  # type: ignore[misc]
        for function in self.module.functions:
            fuse(function)
            if function.blocks:
                # llvmlite writes alignstack only next to another attribute
                function.attributes.add("nounwind")
                function.attributes.alignstack = LINE


class FusingLower(Fusing, Lower):
    """Numba's own lowering of a custom function, then `fuse`."""


class FusingLeanLower(Fusing, LeanLower):
    """`LeanLower`, then `fuse`: for a function of the package."""


class InlineLibrary(JITCodeLibrary):
    """Code that is inlined wherever it is called.

    By itself it is not linked, optimised or compiled to machine code.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries = []

    def add_ir_module(self, ir_module: Any) -> None:
        # Numba would first link it into an empty module.
        self._final_module = llvm.parse_assembly(normalize_ir_text(str(ir_module)))
        self._final_module.name = ir_module.name
        self._final_module.verify()

    def finalize(self) -> None:
        # Two kernels may contain the same function, and one that is inlined everywhere is dropped.
        for function in self.get_defined_functions():
            function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        return self._final_module


@contextlib.contextmanager
def in_written_order() -> Iterator[None]:
    """Keep machine code in the order in which the physics is written, for 32 vector registers.

    The bits are the same in any order. In the order of LLVM's scheduler numbers wait in memory for
    their use: with 512 bits splittings are slower; on ARM rk8 with gravity has a fifth more
    instructions (tests/tools/arm.py).
    """
    if vector_registers() < 32:
        yield
        return
    llvm.set_option("rigidmc", "-enable-misched=0")
    try:
        yield
    finally:
        llvm.set_option("rigidmc", "-enable-misched=1")


class KernelLibrary(JITCodeLibrary):
    """A kernel: all calls are inlined recursively, then it is optimised once.

    Its machine code is made elsewhere, see `rigidmc.engine.compiler.machine_code`.
    """

    def finalize(self) -> None:
        libraries, left = dict.fromkeys(self._linking_libraries), list(self._linking_libraries)
        while left:
            new = [library for library in left.pop()._linking_libraries if library not in libraries]
            libraries.update(dict.fromkeys(new))
            left += new
        self._linking_libraries = list(libraries)
        super().finalize()

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(opt=0)
        passes.add_always_inliner_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, builder)
        # The vectors are members: LLVM could only build further ones from numbers of one member.
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class FusingLowering(NativeLowering):
    """Numba's own pass with `FusingLower`."""

    _name = "rigidmc_fusing_lowering"

    def run_pass(self, state: Any) -> bool:
        context, name, inlines = (
            state.targetctx,
            state.func_id.func_qualname,
            state.flags.forceinline,
        )
        state.library = (InlineLibrary if inlines else KernelLibrary)(context.codegen(), name)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        if inlines:
            result = state.cr
            module = result.fndesc.lookup_module()
            # Numba requires an entry point; it is never called
            entry = make_function(module, name, "inlined", 0, result.env, (state.library,))
            context.insert_user_function(entry, result.fndesc, [state.library])
            state.cr = result._replace(cfunc=entry)
        return True

    @property
    def lowering_class(self) -> type:
        return FusingLower


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanFusingLowering(FusingLowering):
    """`FusingLowering` for a function of the package."""

    _name = "rigidmc_lean_fusing_lowering"

    @property
    def lowering_class(self) -> type:
        return FusingLeanLower


def is_of_package(function: Any) -> bool:
    """Return whether a function belongs to the package, not to a user."""
    return str(function.__module__).startswith("rigidmc.")


class Pipeline(compiler.CompilerBase):
    """Numba's own pipeline, with `FusingLowering` in place of its lowering.

    For functions of the package it skips unneeded work, see `rigidmc.engine.compiler.lean_passes`.
    """

    def define_pipelines(self) -> list[Any]:
        if is_of_package(self.state.func_id.func):
            self.state.targetctx.enable_nrt = False  # none of their values counts references
            return [_lean_passes(self.state)]
        return [_passes(self.state, {NativeLowering: FusingLowering}, set())]


def _passes(state: Any, others: dict[type, type], needless: set[str]) -> Any:
    """Return Numba's own passes, some replaced and some left out."""
    passes = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
    passes.passes = [
        (others.get(pass_class, pass_class), description)
        for pass_class, description in passes.passes
        if pass_class.__name__ not in needless
    ]
    passes.finalize()
    return passes


_lean: list[Any] = []


def _lean_passes(state: Any) -> Any:
    """Return the passes of all functions of the package."""
    if not _lean:
        others = {**LEAN, NativeLowering: LeanFusingLowering, NopythonTypeInference: LeanInference}
        # the state of an inlined function has its code, and Numba then leaves out the first passes
        passes = _passes(compiler.StateDict({**state, "func_ir": None}), others, UNUSED_PASSES)
        passes.__class__ = LeanPasses
        _lean.append(passes)
    return _lean[0]


# No fast-math flag: "nnan" or "ninf" would delete the check for non-finite members, "contract"
# would make bits depend on the code around them, "nsz" would change the sign of a zero. Without
# debugging information a product stays in its register, where `fuse` finds it.
INLINE: Any = {
    "error_model": "numpy", "debug": False, "pipeline_class": Pipeline, "forceinline": True,
    "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
}  # fmt: skip
