"""Formulas: precedence and functions as LAMMPS has them (values below were printed by LAMMPS 22Jul2025 where they surprise)."""

import math

import pytest
from cases import cases

from openmm_dpd.base.errors import ParameterError
from openmm_dpd.lammps.language.expressions import evaluate


class Fixed:
    """A resolver with a few fixed values that says how it was called."""

    def thermo(self, word):
        if word not in ("pe", "step"):
            raise ParameterError(f"there is no thermo word '{word}'")
        return {"pe": 12.0, "step": 40.0}[word]

    def variable(self, name):
        return {"a": 6.0}[name]

    def compute(self, name, index):
        return {("t", None): 1.5, ("u", 4): 2.5}[(name, index)]

    def fix(self, name, index):
        if name != "a":
            raise ParameterError(f"there is no fix {name}")
        return 2.5 if index is None else 10.0 * index

    def group(self, function, arguments):
        return {"count all": 200.0, "count all box": 7.0, "xcm flow x": 0.5}[" ".join([function, *arguments])]

    def atom(self, quantity, bead):
        return {("x", 17): -1.25}[(quantity, bead)]

    def call(self, function, arguments):
        return sum(arguments)


@cases(
    "text, value",
    ("1+2*3", 7),
    ("-2^2", 4),  # unary minus binds tighter than ^
    ("2^3^2", 64),  # from left to right
    ("2^-1", 0.5),
    ("2*-3", -6),
    ("10-2-3", 5),
    ("-7%3", -1),
    ("7%3", 1),
    ("3-(-2)", 5),
    ("-v_a^2", 36),
    ("!0+1", 2),
    ("!1", 0),
    ("1<2==1", 1),
    ("1==1&&2>1||0", 1),
    ("1 >= 2 || 2 != 2", 0),
    ("1e-3+1.5E2 + .5", 150.501),
    ("PI", math.pi),
    ("yes+true+on-no-off-false", 3),
    ("sqrt(2)*exp(1)+ln(3)+log(10)+abs(-1)+floor(-1.5)+ceil(1.2)+round(2.5)+atan2(1,2)", 10.406490925828),
    ("round(-2.5)+10*round(2.5)+100*sign(0)", 128),
    ("sin(0)+cos(0)+tan(0)+asin(0)+acos(1)+atan(0)", 1),
    ("ternary(2>1,5,6)+sign(-3)", 4),
    ("pe/count(all)+step", 40.06),
    ("count(all, box)", 7),
    ("c_t*c_u[2+2]", 3.75),
    ("f_a*f_a[1+1]", 50),
    ("x[17]+xcm(flow,x)", -0.75),
    ("random(1,2,3)+ramp(4,5)", 15),
)
def test_values(text, value):
    assert evaluate(text, Fixed()) == pytest.approx(value, rel=1e-12)


@cases(
    "text, message",
    ("", "it is empty"),
    ("1+", "it ends too early"),
    ("(1+2", r"expected '\)' instead of its end"),
    ("1 2", "unexpected '2'"),
    ("1/0", "division by zero"),
    ("sqrt(-1)", "math domain error"),
    ("exp(1000)", "math range error"),
    ("foo(1)", "there is no function foo"),
    ("sqrt(1,2)", "sqrt takes 1 arguments, not 2"),
    ("temper", "no thermo word 'temper'"),
    ("1 @ 2", "unexpected '@'"),
    ("(" * 3000 + "1" + ")" * 3000, "it is nested too deeply"),
    ("f_1", "there is no fix 1"),
    ("__import__('os')", 'unexpected "\'"'),
)
def test_errors(text, message):
    with pytest.raises(ParameterError, match=message):
        evaluate(text, Fixed())
