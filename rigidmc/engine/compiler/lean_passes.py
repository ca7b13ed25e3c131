"""Numba's passes over a function of the package, without the work that such functions do not need.

Numba analyses the lifetime of each variable after each of five passes, and deletes variables when
their lifetime ends. Here no value counts references, so no variable is deleted and no lifetime is
needed. Most functions have one block, with no branch to prune and nothing to rename.
"""

import functools
from typing import Any

from numba.core import base, event, ir, transforms, types
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.ir_utils import build_definitions, get_definition, guard
from numba.core.rewrites.registry import rewrite_registry
from numba.core.ssa import reconstruct_ssa
from numba.core.typed_passes import PreLowerStripPhis
from numba.core.untyped_passes import DeadBranchPrune, GenericRewrites, IRProcessing, ReconstructSSA

# Passes for closures, `with`, arrays, exceptions and Numba's other ways to inline, and checks and
# texts for users of Numba. The package's functions need none of them.
UNUSED_PASSES = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction",
    "InlineInlinables", "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass",
    "InlineOverloads", "NopythonRewrites", "NoPythonSupportedFeatureValidation", "IRLegalization",
    "AnnotateTypes", "DumpParforDiagnostics",
}  # fmt: skip


class LeanPasses(PassManager):
    """A pass manager that runs passes without events, and without checks between them.

    The caller of the compiler already holds Numba's lock.
    """

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        pss.run_initialization(internal_state)
        pss.run_pass(internal_state)
        pss.run_finalizer(internal_state)


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanProcessing(IRProcessing):
    """Give each loop a single back edge."""

    _name = "rigidmc_lean_processing"

    def run_pass(self, state: Any) -> bool:
        function = state.func_ir
        if len(function.blocks) > 1:
            function.blocks = transforms.canonicalize_cfg(function.blocks)
        return True


_NAMED_TUPLE: Any = types.BaseNamedTuple  # as Any: Numba's stubs lack its fields


def fold_lengths(function: Any, kinds: Any) -> None:
    """Replace len(argument.field) by its number, which the type of a NamedTuple has.

    Numba does so for len(argument): flags may then be fields of a record.
    """
    for block in function.blocks.values():
        for statement in block.find_insts(ir.Assign):
            call = statement.value
            if not isinstance(call, ir.Expr) or call.op != "call" or len(call.args) != 1:
                continue
            called, field = (guard(get_definition, function, x) for x in (call.func, *call.args))
            if getattr(called, "value", None) is not len or getattr(field, "op", "") != "getattr":
                continue
            owner = guard(get_definition, function, field.value)
            kind: Any = kinds[owner.index] if isinstance(owner, ir.Arg) else None
            if isinstance(kind, _NAMED_TUPLE):
                size = ir.Const(len(tuple(kind)[kind.fields.index(field.attr)]), statement.loc)
                function._definitions[statement.target.name] = [size]
                statement.value = size


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanPrune(DeadBranchPrune):
    """Prune branches as Numba does, if there is one."""

    _name = "rigidmc_lean_prune"

    def run_pass(self, state: Any) -> bool:
        if len(state.func_ir.blocks) == 1:
            return True
        fold_lengths(state.func_ir, state.args)
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanRewrites(GenericRewrites):
    """Rewrite blocks as Numba does, for example constant indices, without comparing all blocks
    before and after."""

    _name = "rigidmc_lean_rewrites"

    def run_pass(self, state: Any) -> bool:
        function, typemap, calls = state.func_ir, state.typemap, state.calltypes
        for kind in rewrite_registry.rewrites["before-inference"]:
            rewrite = kind(state)
            pending = list(function.blocks)
            while pending:
                key = pending[-1]
                if rewrite.match(function, function.blocks[key], typemap, calls):
                    function.blocks[key] = rewrite.apply()  # then try again
                else:
                    pending.pop()
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanSSA(ReconstructSSA):
    """Assign each variable once."""

    _name = "rigidmc_lean_ssa"

    def run_pass(self, state: Any) -> bool:
        blocks = state.func_ir.blocks
        if len(blocks) == 1:
            (block,) = blocks.values()
            names = [each.target.name for each in block.body if isinstance(each, ir.Assign)]
            if len(names) == len(set(names)):
                return True
        state.func_ir = reconstruct_ssa(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanStripPhis(PreLowerStripPhis):
    """Assign a variable with alternative values in the blocks where it gets them."""

    _name = "rigidmc_lean_strip_phis"

    def run_pass(self, state: Any) -> bool:
        if len(state.func_ir.blocks) > 1:
            state.func_ir = self._strip_phi_nodes(state.func_ir)
            state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


LEAN: dict[type, type] = {
    IRProcessing: LeanProcessing,
    DeadBranchPrune: LeanPrune,
    GenericRewrites: LeanRewrites,
    ReconstructSSA: LeanSSA,
    PreLowerStripPhis: LeanStripPhis,
}


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
