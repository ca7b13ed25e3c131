"""A function of the package from bytecode to LLVM code, by the steps of Numba that it needs.

Numba has passes for closures, `with`, arrays, exceptions, other ways to inline, and the lifetimes
of variables. The functions of the package need none of them: no value counts references, so no
variable is deleted. Most have one block, with no branch to prune and nothing to rename. In a few
scenes a function is compiled for 3 sets of types; its bytecode is read once, and Numba's untyped
form is copied. Signatures of calls are cached. The code is the same as Numba's, and is ready
sooner.
"""

import copy
import functools
import operator
from collections import Counter
from typing import Any, NamedTuple

import numba
from numba import njit
from numba.core import base, compiler, errors, event, ir, types
from numba.core.analysis import dead_branch_prune, rewrite_semantic_constants
from numba.core.bytecode import FunctionIdentity
from numba.core.cgutils import alloca_once
from numba.core.consts import ConstantInference
from numba.core.funcdesc import PythonFunctionDescriptor
from numba.core.ir_utils import build_definitions, get_definition, guard
from numba.core.lowering import Lower
from numba.core.registry import cpu_target
from numba.core.rewrites.registry import rewrite_registry
from numba.core.ssa import reconstruct_ssa
from numba.core.targetconfig import ConfigStack
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import PreLowerStripPhis
from numba.core.typeinfer import TypeInferer
from numba.core.typing.templates import signature
from numba.core.untyped_passes import ExtractByteCode, TranslateByteCode

from rigidmc.engine.compiler.libraries import Fusing, InlineLibrary, KernelLibrary
from rigidmc.engine.compiler.pipeline import INLINE, entry_point


class LoweredFunction(NamedTuple):
    """A function as LLVM code.

    entry_point : stands for the function in calls; None for a kernel
    signature : types of result and arguments
    symbol : name of the function in the code of the library
    """

    entry_point: Any
    signature: Any
    symbol: str
    library: Any


def lower_kernel(function: Any, arguments: tuple[Any, ...], result: Any = None) -> LoweredFunction:
    """Compile a function, with all that it calls, to one optimised LLVM module."""
    numba.config.reload_config()
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    return lower_function(function, arguments, result, inlines=False)


def lower_function(
    function: Any, arguments: tuple[Any, ...], result: Any = None, inlines: bool = True
) -> LoweredFunction:
    """Compile a function for arguments of these types, by default one that kernels inline.

    result : its type, by default as it comes out
    """
    flags, context = _flags_and_target(inlines)
    code = copy_code(_translate(function))
    # Numba names each compiled function by a running number.
    identity = code.func_id = copy.copy(code.func_id)
    identity.unique_id = next(FunctionIdentity._unique_ids)
    identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
    with ConfigStack().enter(flags.copy()):
        try:
            code = _simplified(code, arguments)
            typemap, result, calltypes = _infer(code, arguments, result, context)
            code = _without_phis(code)
            described = PythonFunctionDescriptor.from_specialized_function(
                code, typemap, result, calltypes, mangler=context.mangler, inline=inlines,
                noalias=flags.noalias, abi_tags=[flags.get_mangle_string()],
            )  # fmt: skip
            library = (InlineLibrary if inlines else KernelLibrary)(
                context.codegen(), identity.func_qualname
            )
            with context.push_code_library(library):
                lower = LeanLower(context, library, described, code)
                lower.lower()
        except errors.NumbaError as error:  # see `rigidmc.engine.compiler.compose.innermost_cause`
            error.args = f"Failed in nopython mode pipeline\n{error}", *error.args[1:]
            raise
    library.finalize()
    entry = entry_point(context, described, lower.env, library) if inlines else None
    return LoweredFunction(entry, signature(result, *arguments), described.llvm_func_name, library)


@functools.cache
def _flags_and_target(inlines: bool) -> tuple[Any, Any]:
    """Return Numba's flags and context for all inlined functions, or for all kernels."""
    options = njit(**{**INLINE, "forceinline": inlines})(lower_function).targetoptions
    cpu_target.options.parse_as_flags(flags := compiler.Flags(), options)
    target = compiler._make_subtarget(cpu_target.target_context, flags)
    target.enable_nrt = False  # no value counts references
    return flags, target


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
    for name, definitions in code._definitions.items():
        made._definitions[name] = [values.get(id(value), value) for value in definitions]
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


def _simplified(code: Any, arguments: tuple[Any, ...]) -> Any:
    """Return Numba's form of a function without dead branches, each variable assigned once."""
    rewrite_semantic_constants(code, arguments)
    _prune(code, arguments)
    for kind in rewrite_registry.rewrites["before-inference"]:  # for example constant indices
        rewrite, pending = kind(None), list(code.blocks)
        while pending:
            key = pending[-1]
            if rewrite.match(code, code.blocks[key], None, None):
                code.blocks[key] = rewrite.apply()  # then try again
            else:
                pending.pop()
    _prune(code, arguments)
    names = [name for block in code.blocks.values() for name in _assigned(block)]
    if len(code.blocks) > 1 or len(names) > len(set(names)):
        code = reconstruct_ssa(code)
        code._definitions = build_definitions(code.blocks)
    _prune(code, arguments)
    return code


def _prune(code: Any, arguments: tuple[Any, ...]) -> None:
    if len(code.blocks) > 1:
        dead_branch_prune(code, arguments)  # first: an untaken side may have no types
        if fold_lengths(code, arguments):
            dead_branch_prune(code, arguments)


_TUPLE: Any = types.BaseTuple  # as Any: Numba's stubs lack the items of tuples


def fold_lengths(code: Any, arguments: tuple[Any, ...]) -> bool:
    """Replace len(x) by its number where the type of x follows from the types of the arguments.

    Numba does so if x is an argument. Here it may also be a field or an item of one, or the result
    of a call with such values. Return whether anything has changed.
    """
    has_changed = False
    for statement in [x for block in code.blocks.values() for x in block.find_insts(ir.Assign)]:
        call = statement.value
        if not isinstance(call, ir.Expr) or call.op != "call" or len(call.args) != 1:
            continue
        called, value = (guard(get_definition, code, x) for x in (call.func, *call.args))
        if getattr(called, "value", None) is len and isinstance(value, ir.Expr):
            kind = _type_of(code, arguments, value)
            if isinstance(kind, _TUPLE):
                statement.value = ir.Const(len(kind), statement.loc)
                code._definitions[statement.target.name] = [statement.value]
                has_changed = True
    return has_changed


def _type_of(code: Any, arguments: tuple[Any, ...], value: Any) -> Any:
    """Return the type of a value that follows from the types of the arguments, else None."""

    def defined(variable: Any) -> Any:
        return guard(get_definition, code, variable)

    if isinstance(value, ir.Arg):
        return arguments[value.index]
    if not isinstance(value, ir.Expr) or value.op not in ("getattr", "getitem", "call"):
        return None
    if value.op == "call":
        called = getattr(defined(value.func), "value", None)
        kinds = [_type_of(code, arguments, defined(x)) for x in value.args]
        if value.kws or value.vararg or not callable(called) or None in kinds:
            return None
        typing = cpu_target.typing_context
        return _signature(typing, typing.resolve_value_type(called), kinds).return_type
    owner = _type_of(code, arguments, defined(value.value))
    if value.op == "getattr":
        fields = getattr(owner, "fields", ())
        return tuple(owner)[fields.index(value.attr)] if value.attr in fields else None
    place = defined(value.index)
    index = None if isinstance(place, ir.Expr) else getattr(place, "value", None)  # or a slice
    return tuple(owner)[index] if isinstance(owner, _TUPLE) and type(index) is int else None


def _assigned(block: Any) -> list[str]:
    """Return the names of variables that a block assigns."""
    return [each.target.name for each in block.body if isinstance(each, ir.Assign)]


def _without_phis(code: Any) -> Any:
    """Assign a variable with alternative values in the blocks where it gets them."""
    if len(code.blocks) > 1:
        code = PreLowerStripPhis()._strip_phi_nodes(code)
        code._definitions = build_definitions(code.blocks)
    return code


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


def _infer(code: Any, arguments: tuple[Any, ...], result: Any, target: Any) -> tuple[Any, Any, Any]:
    """Return the types of variables, of the result, and of calls, as Numba infers them."""
    context = cpu_target.typing_context
    infer = _Inference(context, code, _Unfiltered(errors.NumbaWarning))
    with context.callstack.register(target.target, infer, code.func_id, arguments):
        for i, (name, kind) in enumerate(zip(code.arg_names, arguments, strict=True)):
            infer.seed_argument(name, i, kind)
        if result is not None:
            infer.seed_return(result)
        infer.build_constraint()
        infer.propagate()
        typemap, result, calltypes = infer.unify()
    return typemap, result, calltypes


class LeanLower(Fusing, Lower):
    """Numba's own lowering of a function, without texts of instructions for error messages.

    No variable is deleted, and there is no `try`.
    """

    def _find_singly_assigned_variable(self) -> None:
        if len(self.func_ir.blocks) > 1:
            super()._find_singly_assigned_variable()
            return
        (block,) = self.func_ir.blocks.values()
        count = Counter(_assigned(block))
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
        folded = self.fold_call_args(kind, signature, expr.args, expr.vararg, expr.kws)
        value = self.context.get_function(kind, signature)(self.builder, folded, self.loc)
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


def _heard(tell: Any) -> Any:
    """Return `tell` of Numba's events, called only for kinds of events that have a listener."""

    def told(kind: str, *arguments: Any, **words: Any) -> None:
        if event._registered.get(kind):
            tell(kind, *arguments, **words)

    return told


# Numba makes two events at each call of LLVM, and inspects a code-generating function at each call
# of it: together a fourteenth of the compilation time.
vars(event).update(start_event=_heard(event.start_event), end_event=_heard(event.end_event))
if inspects := vars(base).get("_has_loc"):
    vars(base)["_has_loc"] = functools.cache(inspects)
