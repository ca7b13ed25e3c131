"""How everything is compiled: what has no life of its own is inlined into what has, which is then optimised, once."""

from numba._dynfunc import make_function
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering

from rigidmc.engine.fused import fuse

LINE = 64  # bytes of a cache line, and of the widest vectors: one that lies across two lines takes two accesses


class FusingLower(Lower):
    """Numba's own lowering of a function, then `fuse`."""

    def lower_normal_function(self, fndesc):
        super().lower_normal_function(fndesc)
        for function in self.module.functions:
            fuse(function)
            if function.blocks:
                function.attributes.add("nounwind")  # alone, the next one would not be written
                function.attributes.alignstack = LINE


class Inlined(JITCodeLibrary):
    """Code that has no life of its own: it is inlined wherever it is called, and before that neither linked, optimised nor made into machine code."""

    def _optimize_functions(self, ll_module):
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self):
        for function in self.get_defined_functions():
            function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self):
        return self._final_module


class Flat(JITCodeLibrary):
    """Code whose calls, and the calls in those, are all inlined first, and which is then optimised once."""

    def finalize(self):
        found, left = dict.fromkeys(self._linking_libraries), list(self._linking_libraries)
        while left:
            new = [library for library in left.pop()._linking_libraries if library not in found]
            found.update(dict.fromkeys(new))
            left += new
        self._linking_libraries = list(found)
        super().finalize()

    def _optimize_final_module(self):
        passes, builder = self._codegen._module_pass_manager(opt=0)
        passes.add_always_inliner_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, builder)
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False
        )
        passes.run(self._final_module, builder)


@register_pass(mutates_CFG=True, analysis_only=False)
class FusingLowering(NativeLowering):
    """Numba's own pass with `FusingLower`."""

    _name = "rigidmc_fusing_lowering"

    def run_pass(self, state):
        context, name = state.targetctx, state.func_id.func_qualname
        if not state.flags.forceinline:
            state.library = Flat(context.codegen(), name)
            state.library.enable_object_caching()
            return super().run_pass(state)
        state.library, state.flags.no_compile = Inlined(context.codegen(), name), True
        super().run_pass(state)
        made = state.cr
        entry = make_function(
            made.fndesc.lookup_module(), name, "inlined", 0, made.env, (state.library,)
        )  # never called
        context.insert_user_function(entry, state.cr.fndesc, [state.library])
        state.cr = made._replace(cfunc=entry)
        return True

    @property
    def lowering_class(self):
        return FusingLower


# Passes for closures, `with`, arrays, exceptions and Numba's other ways to inline, none of which the package's own functions have
# use for: an eighth of the time.
NEEDLESS = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "InlineInlinables", "FindLiterallyCalls", "LiteralUnroll",
    "LiteralPropagationSubPipelinePass", "InlineOverloads", "NopythonRewrites",
}  # fmt: skip


class Pipeline(compiler.CompilerBase):
    """Numba's own pipeline with `FusingLowering` in the place of its lowering, and for the package's own functions no more than they need."""

    def define_pipelines(self):
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        needless = NEEDLESS if self.state.func_id.func.__module__.startswith("rigidmc.") else ()
        passes.passes = [
            (FusingLowering if kind is NativeLowering else kind, what)
            for kind, what in passes.passes
            if kind.__name__ not in needless
        ]
        passes.finalize()
        return [passes]


# No flag of fast arithmetic: "nnan" or "ninf" would delete the check for non-finite members, "contract" would let bits depend on what is compiled beside
# them, "nsz" would let the sign of a zero. Without debugging information a product stays in its register, where the rule finds it.
FLAGS = {"error_model": "numpy", "debug": False, "pipeline_class": Pipeline}
INLINE = {**FLAGS, "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
