"""Which product is fused with a sum: settled here, so that a member's bits depend on no compiler's choice.

A compiler that may fuse a*b + c*d chooses the product by what stands around it: by other saves, another width, another machine. Here the rule is one for
all: of a sum or difference, the left operand that is a product made in the same function becomes a fused multiply-add (`llvm.fma`), else the right one; nothing else is fused.
Everything else in a step is +, -, *, / and square roots, which IEEE 754 fixes.
"""

from llvmlite import ir


def fuse(function):
    """Replace sums of products by fused multiply-adds, throughout one function of LLVM's code."""
    for block in function.blocks:
        block.instructions[:] = [
            made
            for instruction in block.instructions
            for made in _fused(function.module, block, instruction)
        ]


def _fused(module, block, instruction):
    """The instructions in the place of one: itself, or of a sum that has a product the fused multiply-add, with what it needs."""
    if instruction.opname not in ("fadd", "fsub"):
        return [instruction]
    left, right = instruction.operands
    product, other = (left, right) if _factors(left) else (right, left)
    if not _factors(product):
        return [instruction]
    kind, more = instruction.type, []

    def made(*words):
        more.append(ir.instructions.Instruction(block, *words))
        return more[-1]

    one, two = _factors(product)
    if isinstance(kind, ir.VectorType) and not isinstance(
        one.type, ir.VectorType
    ):  # a product that all members share
        one, two = (_broadcast(block, kind, x, more) for x in (one, two))
    if instruction.opname == "fsub":  # a b - y = fma(a, b, -y);  x - a b = fma(-a, b, x)
        if product is left:
            other = made(kind, "fneg", [other])
        else:
            one = made(kind, "fneg", [one])
    word = f"llvm.fma.{_name(kind)}"
    fma = ir.instructions.CallInstr(
        block,
        module.declare_intrinsic(word, (), ir.FunctionType(kind, [kind] * 3)),
        [one, two, other],
    )
    fma._name = instruction._name  # the code is read as text: whoever takes the sum takes this
    return [*more, fma]


def _factors(value):
    """Of a product made in this function, or of a vector that is such a product broadcast, its two factors; else None."""
    word = getattr(value, "opname", None)
    if word == "fmul":
        return value.operands
    if word == "shufflevector" and getattr(value.operands[0], "opname", None) == "insertelement":
        return _factors(value.operands[0].operands[1])
    return None


def _broadcast(block, kind, x, more):
    """The instructions, added to `more`, that make a vector whose numbers all are x."""
    none = ir.Constant(kind, ir.Undefined)
    first = ir.instructions.InsertElement(block, none, x, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    every = ir.instructions.ShuffleVector(block, first, none, places)
    more += [first, every]
    return every


def _name(kind):
    """What LLVM calls a type of numbers in the names of its functions."""
    if isinstance(kind, ir.VectorType):
        return f"v{kind.count}{_name(kind.element)}"
    return "f64" if isinstance(kind, ir.DoubleType) else "f32"
