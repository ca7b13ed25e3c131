"""The rule that fuses products with sums, fixed here so that no bit depends on a compiler's choice.

A compiler that may fuse a*b + c*d chooses the product by its surroundings: other saves, another
width, another machine. Here one rule holds for all. In a sum or difference, the left operand
becomes part of a fused multiply-add (`llvm.fma`) if it is a product made in the same function, else
the right operand if it is one. Nothing else is fused. Everything else in a step is +, -, *, / and
square roots, which IEEE 754 fixes.
"""

from typing import Any

from llvmlite import ir

from rigidmc.engine.compiler.dual_types import part_of_dual


def fuse(function: ir.Function) -> None:
    """Replace sums of products by fused multiply-adds, throughout one LLVM function."""
    for block in function.blocks:
        block.instructions[:] = [
            new
            for instruction in block.instructions
            for new in _fuse_sum(function.module, block, instruction)
        ]


def _fuse_sum(module: Any, block: Any, instruction: Any) -> list[Any]:
    """Return the instructions that replace one: for a sum with a product a fused multiply-add, else
    the instruction itself."""
    if instruction.opname not in ("fadd", "fsub"):
        return [instruction]
    left, right = instruction.operands
    # The rule: the left operand first.
    product, other = (left, right) if _factors(left) else (right, left)
    factors = _factors(product)
    if not factors:
        return [instruction]
    ty, added = instruction.type, list[Any]()

    def negated(value: Any) -> Any:
        added.append(ir.instructions.Instruction(block, ty, "fneg", [value]))
        return added[-1]

    factor, other_factor = factors
    vector = isinstance(ty, ir.VectorType)
    if vector and not isinstance(factor.type, ir.VectorType):  # a product shared by all members
        factor, other_factor = (_broadcast(block, ty, x, added) for x in (factor, other_factor))
    if instruction.opname == "fsub":  # a b - y = fma(a, b, -y);  x - a b = fma(-a, b, x)
        if product is left:
            other = negated(other)
        else:
            factor = negated(factor)
    signature = ir.FunctionType(ty, [ty] * 3)
    name = module.declare_intrinsic(f"llvm.fma.{_name(ty)}", (), signature)
    fma = ir.instructions.CallInstr(block, name, [factor, other_factor, other])
    fma._name = instruction._name  # code is linked as text: users of the sum now use this
    return [*added, fma]


def _factors(value: Any) -> Any:
    """Return the factors of a product made in this function, broadcast or not; else None."""
    value = part_of_dual(value)
    operation = getattr(value, "opname", None)  # arguments and constants have none
    if operation == "fmul":
        return value.operands
    # A product shared by all members is made once and broadcast; for a plain number it is the same
    # product.
    if (
        operation == "shufflevector"
        and getattr(value.operands[0], "opname", None) == "insertelement"
    ):
        return _factors(value.operands[0].operands[1])
    return None


def _broadcast(block: Any, ty: Any, x: Any, added: list[Any]) -> Any:
    """Return a vector whose numbers are all x; append its instructions to `added`."""
    undefined = ir.Constant(ty, ir.Undefined)
    first = ir.instructions.InsertElement(block, undefined, x, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), ty.count), [0] * ty.count)
    every = ir.instructions.ShuffleVector(block, first, undefined, zeros)
    added += [first, every]
    return every


def _name(ty: Any) -> str:
    """Return LLVM's name of a number type, as used in the names of its functions."""
    if isinstance(ty, ir.VectorType):
        return f"v{ty.count}{_name(ty.element)}"
    return "f64" if isinstance(ty, ir.DoubleType) else "f32"
