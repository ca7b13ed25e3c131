"""Numba's pipeline for custom functions, which may do what functions of the package do not.

Only its lowering is another one: a custom function, too, is fused, stops at LLVM code and is
inlined wherever it is called.
"""

from typing import Any

from numba._dynfunc import make_function
from numba.core import compiler
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering

from rigidmc.engine.compiler.libraries import Fusing, InlineLibrary


class FusingLower(Fusing, Lower):
    """Numba's own lowering of a custom function, then `fuse`."""


@register_pass(mutates_CFG=True, analysis_only=False)
class FusingLowering(NativeLowering):
    """Numba's own pass with `FusingLower`."""

    _name = "rigidmc_fusing_lowering"

    def run_pass(self, state: Any) -> bool:
        context = state.targetctx
        state.library = InlineLibrary(context.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        result = state.cr
        state.cr = result._replace(
            cfunc=entry_point(context, result.fndesc, result.env, state.library)
        )
        return True

    @property
    def lowering_class(self) -> type:
        return FusingLower


def entry_point(context: Any, described: Any, environment: Any, library: Any) -> Any:
    """Return what Numba requires for a function that is inlined: it is never called."""
    name, module = described.qualname, described.lookup_module()
    entry = make_function(module, name, "inlined", 0, environment, (library,))
    context.insert_user_function(entry, described, [library])
    return entry


class Pipeline(compiler.CompilerBase):
    """Numba's own pipeline, with `FusingLowering` in place of its lowering."""

    def define_pipelines(self) -> list[Any]:
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [
            (FusingLowering if pass_class is NativeLowering else pass_class, description)
            for pass_class, description in passes.passes
        ]
        passes.finalize()
        return [passes]


# No fast-math flag: "nnan" or "ninf" would delete the check for non-finite members, "contract"
# would make bits depend on the code around them, "nsz" would change the sign of a zero. Without
# debugging information a product stays in its register, where `fuse` finds it.
INLINE: Any = {
    "error_model": "numpy", "debug": False, "pipeline_class": Pipeline, "forceinline": True,
    "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
}  # fmt: skip
