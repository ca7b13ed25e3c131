"""Which product is fused with a sum: settled here, so that a member's bits do not depend on what else is compiled, on vectors or on processors.

A compiler that may fuse a*b + c*d chooses the product by what stands around it: by other saves, another width, another machine. Here the rule is one for
all: of a sum or difference, the left operand that is a product made in the same function becomes a fused multiply-add (`llvm.fma`), else the right one; nothing else is fused.
Everything else in a step is +, -, *, / and square roots, which IEEE 754 fixes.
"""

from llvmlite import ir
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


class FusingLower(Lower):
    """Numba's own lowering of a function, then `fuse`."""

    def lower_normal_function(self, fndesc):
        super().lower_normal_function(fndesc)
        for function in self.module.functions:
            fuse(function)


@register_pass(mutates_CFG=True, analysis_only=False)
class FusingLowering(NativeLowering):
    """Numba's own pass with `FusingLower`."""

    _name = "rigidmc_fusing_lowering"

    @property
    def lowering_class(self):
        return FusingLower


def fuse(function):
    """Replace sums of products by fused multiply-adds, throughout one function of LLVM's code."""
    for block in function.blocks:
        block.instructions[:] = [made for instruction in block.instructions for made in _fused(function.module, block, instruction)]


def _fused(module, block, instruction):
    """The instructions in the place of one: itself, or of a sum that has a product the fused multiply-add, with what it needs."""
    if instruction.opname not in ("fadd", "fsub") or not any(map(_is_product, instruction.operands)):
        return [instruction]
    left, right = instruction.operands
    product, other = (left, right) if _is_product(left) else (right, left)
    one, two = product.operands
    turned = []
    if instruction.opname == "fsub":  # a b - y = fma(a, b, -y);  x - a b = fma(-a, b, x)
        turned = [ir.instructions.Instruction(block, instruction.type, "fneg", [other if product is left else one])]
        one, other = (one, turned[0]) if product is left else (turned[0], other)
    kind = instruction.type
    fma = ir.instructions.CallInstr(
        block, module.declare_intrinsic("llvm.fma", [kind], ir.FunctionType(kind, [kind] * 3)), [one, two, other]
    )
    fma._name = instruction._name  # the code is read as text: whoever takes the sum takes this
    return [*turned, fma]


def _is_product(value):
    return getattr(value, "opname", None) == "fmul"
