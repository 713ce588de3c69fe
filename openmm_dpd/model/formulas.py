"""Formulas of the position, checked before OpenMM reads them.

OpenMM reports syntax errors with the full expression only, never reports values that are not finite, and hangs on formulas whose constants
give NaN, such as ``sqrt(-1)*x``, because its optimiser iterates until two results are equal."""

import ast
import operator
from collections.abc import Callable, Mapping

import numpy as np
import scipy

from ..base.errors import ParameterError

#: OpenMM's functions: number of arguments, and the equivalent in numpy.
FUNCTIONS: dict[str, tuple[int, Callable]] = {
    **{name: (1, getattr(np, name)) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh", "floor", "ceil")},
    **{name: (1, getattr(np, f"arc{name[1:]}")) for name in ("asin", "acos", "atan")},
    "atan2": (2, np.arctan2),
    "erf": (1, lambda x: scipy.special.erf(x)),
    "step": (1, lambda x: np.where(np.asarray(x) >= 0, 1.0, 0.0)),
    "delta": (1, lambda x: np.where(np.asarray(x) == 0, 1.0, 0.0)),
    "square": (1, np.square),
    "cube": (1, lambda x: x * x * x),
    "recip": (1, lambda x: 1.0 / x),
    "abs": (1, np.abs),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
    "select": (3, lambda test, yes, no: np.where(np.asarray(test) != 0, yes, no)),
}

_OPERATORS: dict[type, Callable] = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}


def read_formula(text: str, names: tuple[str, ...], what: str) -> ast.expr:
    """Syntax tree of a formula in OpenMM's expression language.  ParameterError if it cannot be read, has other names than ``names`` and
    OpenMM's functions, a function has the wrong number of arguments, or a constant part has no finite value."""
    if ";" in text or "=" in text:
        raise ParameterError(f"the formula '{text}' of {what} must be one expression")
    bad = next((sign for sign in ("**", "//") if sign in text), None)
    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        bad = bad or "syntax"
    if bad:
        raise ParameterError(f"the formula '{text}' of {what} cannot be read; write it as OpenMM does, such as 0.1*sin(2*x)^2")
    _check(tree, text, names, what)
    return tree


def values(tree: ast.expr, variables: Mapping[str, np.ndarray]):
    """Value of a formula from :func:`read_formula` for these variables."""
    with np.errstate(all="ignore"):
        return _value(tree, variables)


def _check(node: ast.expr, text: str, names: tuple[str, ...], what: str) -> bool:
    """Whether a part of a formula is constant; ParameterError if it is not valid, or constant but not finite."""

    def wrong(reason: str) -> ParameterError:
        return ParameterError(f"the formula '{text}' of {what} {reason}")

    if isinstance(node, ast.Name):
        if node.id not in names:
            raise wrong(f"names {node.id!r}; it may use {', '.join(names)} and OpenMM's functions")
        return False
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        parts: list[ast.expr] = []
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        parts = [node.operand]
    elif isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Pow, *_OPERATORS)):
        parts = [node.left, node.right]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise wrong(f"names {node.func.id!r}; it may use {', '.join(names)} and OpenMM's functions")
        count = FUNCTIONS[node.func.id][0]
        if len(node.args) != count:
            raise wrong(f"calls {node.func.id} with {len(node.args)} arguments; it takes {count}")
        parts = node.args
    else:
        raise wrong("cannot be read; write it as OpenMM does, such as 0.1*sin(2*x)^2")
    # a list, not a generator, so that every part is checked
    constant = all([_check(part, text, names, what) for part in parts])
    if constant and not np.isfinite(values(node, {})):
        raise wrong(f"has a part without a finite value: {ast.unparse(node).replace('**', '^')}")
    return constant


def _value(node: ast.expr, variables: Mapping[str, np.ndarray]):
    """Value of a part of a formula for these variables."""
    if isinstance(node, ast.Name):
        return variables[node.id]
    if isinstance(node, ast.Constant):
        return np.float64(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.UnaryOp):
        return -_value(node.operand, variables)
    if isinstance(node, ast.BinOp):
        left, right = _value(node.left, variables), _value(node.right, variables)
        return np.power(left, right) if isinstance(node.op, ast.Pow) else _OPERATORS[type(node.op)](left, right)
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return FUNCTIONS[node.func.id][1](*(_value(part, variables) for part in node.args))
