"""Numba's passes over a function, for functions of the package: without what these have no use for.

Numba looks for the lifetime of each variable after each of five passes, and deletes variables when
they end. Here no value counts references, so that no variable is deleted and nobody asks for a
lifetime. Most functions have one block, in which there is no branch to prune and nothing to rename.
"""

import functools
from typing import Any

from numba.core import base, event, ir, transforms
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.ir_utils import build_definitions
from numba.core.rewrites.registry import rewrite_registry
from numba.core.ssa import reconstruct_ssa
from numba.core.typed_passes import PreLowerStripPhis
from numba.core.untyped_passes import DeadBranchPrune, GenericRewrites, IRProcessing, ReconstructSSA

# Passes for closures, `with`, arrays, exceptions and Numba's other ways to inline, and checks and
# texts for users of Numba. The package's functions use none of them.
UNUSED_PASSES = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction",
    "InlineInlinables", "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass",
    "InlineOverloads", "NopythonRewrites", "NoPythonSupportedFeatureValidation", "IRLegalization",
    "AnnotateTypes", "DumpParforDiagnostics",
}  # fmt: skip


class LeanPasses(PassManager):
    """Runs passes without events, and without checks of functions between them.

    Whoever compiles holds Numba's lock already.
    """

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        pss.run_initialization(internal_state)
        pss.run_pass(internal_state)
        pss.run_finalizer(internal_state)


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanProcessing(IRProcessing):
    """One way back in each loop."""

    _name = "rigidmc_lean_processing"

    def run_pass(self, state: Any) -> bool:
        function = state.func_ir
        if len(function.blocks) > 1:
            function.blocks = transforms.canonicalize_cfg(function.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanPrune(DeadBranchPrune):
    """Numba's own pruning of branches, where there is one."""

    _name = "rigidmc_lean_prune"

    def run_pass(self, state: Any) -> bool:
        return len(state.func_ir.blocks) == 1 or bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanRewrites(GenericRewrites):
    """Numba's own rewrites of a block, as of a constant index, without a comparison of all blocks
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
                    function.blocks[key] = rewrite.apply()  # and once more
                else:
                    pending.pop()
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class LeanSSA(ReconstructSSA):
    """One assignment for each variable."""

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
    """A variable that has one value or another is assigned in the blocks where it gets them."""

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
    """`tell` of Numba's events, for kinds of events that somebody listens to."""

    def told(kind: str, *arguments: Any, **words: Any) -> None:
        if event._registered.get(kind):
            tell(kind, *arguments, **words)

    return told


# Numba makes two events at each call of LLVM's, and inspects a function that generates code at each
# call of it: a fourteenth of the time of a compilation.
vars(event).update(start_event=_heard(event.start_event), end_event=_heard(event.end_event))
if inspects := vars(base).get("_has_loc"):
    vars(base)["_has_loc"] = functools.cache(inspects)
