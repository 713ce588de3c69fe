"""Text of a deck to words: continuation, comments, quotes, substitution, variables; formulas with LAMMPS's precedence and functions."""

import gzip
import math

import pytest
from cases import cases, raises

from openmm_dpd.base.errors import DeckError, ParameterError
from openmm_dpd.lammps.language.expressions import evaluate
from openmm_dpd.lammps.language.lexer import Line, logical_lines, read_text, split_words, strip_comment, substitute
from openmm_dpd.lammps.language.variables import Variables

HERE = Line("", "deck", 1)


def lines(text: str) -> list[tuple[int, str]]:
    return [(line.number, line.text) for line in logical_lines(text, "deck")]


def test_numbers_of_lines_are_those_of_the_first_physical_line():
    found = lines("units lj\n\n# only a comment\npair_coeff 1 1 &\n   25 &\n 4.5 # why\nrun 10\n")
    assert [number for number, _ in found] == [1, 4, 7]
    assert split_words(found[1][1]) == ["pair_coeff", "1", "1", "25", "4.5"]


@cases(
    "text, found",
    # LAMMPS joins lines before it looks for comments
    ("variable q equal 1 # text &\nvariable r equal 2\nrun 1", [(1, "variable q equal 1"), (3, "run 1")]),
    ("run 10 &", [(1, "run 10")]),
    ("# one page\f the next\nrun\f10", [(2, "run\f10")]),
)
def test_comments_and_marks_of_lines(text, found):
    assert lines(text) == found


@pytest.mark.parametrize("text", ["run\t10\r\n", "run\f10"])
def test_blanks_and_line_ends(text):
    assert split_words(lines(text)[0][1]) == ["run", "10"]


@pytest.mark.parametrize("content", [b"\xef\xbb\xbfunits lj\r\n", gzip.compress(b"units lj")], ids=["byte-order mark", "gzip"])
def test_what_is_about_the_text_is_left_aside(tmp_path, content):
    (tmp_path / "deck").write_bytes(content)
    assert lines(read_text(tmp_path / "deck")) == [(1, "units lj")]


@cases(
    "text, line", (b"units lj\nprint \xc5ngstrom\n", 2), (b'units lj\n\nprint "# \xc5ngstrom"\n', 3), (b"units lj \xc5 # \xc5ngstrom\n", 1)
)
def test_other_encodings_are_named_with_their_line(tmp_path, text, line):
    (tmp_path / "deck").write_bytes(text)
    raises(DeckError, rf"deck:{line}: the file is not UTF-8 text \(byte 0xc5\)", lambda: read_text(tmp_path / "deck"))


def test_other_encodings_in_a_text_of_several_lines_are_an_error(tmp_path):
    (tmp_path / "deck").write_bytes(b'units lj\nprint """one\n# \xc5ngstrom"""\n')
    raises(DeckError, "deck:2: the multi-line text that begins here is not UTF-8", lambda: lines(read_text(tmp_path / "deck")))


def test_other_encodings_are_read_in_comments(tmp_path):
    (tmp_path / "deck").write_bytes(b"units lj # in \xc5ngstrom\r\n# \xb5m, it's small\nrun 10")
    assert lines(read_text(tmp_path / "deck")) == [(1, "units lj"), (3, "run 10")]
    (tmp_path / "data").write_bytes(b"M\xfcller's beads\n\n5 atoms\n")
    assert read_text(tmp_path / "data", title=True).split("\n")[2] == "5 atoms"
    raises(DeckError, "data:1: .*0xfc", lambda: read_text(tmp_path / "data"))


@cases(
    "text, kept",
    ("run 1 # 2", "run 1 "),
    ('print "a # b" # c', 'print "a # b" '),
    ("print 'a \" # b'", "print 'a \" # b'"),
    ('print """x "y" # z""" # w', 'print """x "y" # z""" '),
)
def test_comments_end_lines_outside_quotes_only(text, kept):
    assert strip_comment(text) == kept


def test_quotes_hold_words_together():
    assert split_words("""a 'b c' "d 'e' f" \"\"\"g "h" i\"\"\" j""") == ["a", "b c", "d 'e' f", 'g "h" i', "j"]


def test_triple_quotes_reach_over_lines():
    found = lines('print """first\nsecond"""\nrun 1')
    assert split_words(found[0][1]) == ["print", "first\nsecond"]
    assert found[1] == (3, "run 1")


def test_an_open_quote_is_an_error_with_its_line():
    raises(DeckError, r'deck:2: unbalanced quotes: " is never closed', lambda: lines('run 1\nprint "open\nrun 2'))


def expand(text: str) -> str:
    return substitute(text, {"T": "1.5", "name": "value"}.__getitem__, lambda formula: {"1/3": 1 / 3, "sqrt(2)*(1+1)": 2.5}[formula])


@cases(
    "text, result",
    ("dpd ${T} $T 1.0", "dpd 1.5 1.5 1.0"),
    ("a${name}b", "avalueb"),
    ("$(1/3)", "0.33333333333333331483"),
    ("$(1/3:%.3f)x", "0.333x"),
    ("$(sqrt(2)*(1+1))", "2.5"),
    ("print '$T ${name}' $T", "print '$T ${name}' 1.5"),
)
def test_substitution(text, result):
    assert expand(text) == result


@pytest.mark.parametrize("text", ["${T", "$(1/3", "a $", "$ T", "$(1/3:%q)"])
def test_broken_substitutions(text):
    with pytest.raises(ValueError):
        expand(text)


# -- variables ---------------------------------------------------------------------------------------------------------------
def define(variables: Variables, text: str) -> None:
    variables.define(split_words(text), HERE, lambda words: words.replace("$x", "[x]"))


def value(variables: Variables, name: str) -> str:
    return variables.text(name, lambda formula: float(formula))


def test_an_index_variable_keeps_its_first_value():
    variables = Variables({"n": "from outside"})
    define(variables, "n index 10")
    define(variables, "m index 1 2 3")
    define(variables, "m index 7")
    assert (value(variables, "n"), value(variables, "m")) == ("from outside", "1")


def test_equal_and_string_variables_are_replaced():
    variables = Variables()
    define(variables, "a equal 1e20")
    assert value(variables, "a") == "1e+20"
    define(variables, "a equal 0.25")
    define(variables, "s string '$x y'")
    assert value(variables, "a") == "0.25"
    assert value(variables, "s") == "[x] y"


def test_delete_forgets_a_variable():
    variables = Variables()
    define(variables, "a equal 1")
    define(variables, "a delete")
    define(variables, "a string b")
    assert value(variables, "a") == "b"


@cases(
    "text, message",
    ("a python f", "variable style 'python' is not supported"),
    ("a-b equal 1", "letters, digits and underscores"),
    ("a equal", "expected one value"),
    ("outer equal 2", "is already index-style and cannot become equal-style; a value from the command line"),
)
def test_variables_that_cannot_be_defined(text, message):
    raises(ParameterError, message, lambda: define(Variables({"outer": "1"}), text))


def test_an_unknown_variable_is_named_with_the_known_ones():
    raises(ParameterError, "no variable 'b'; defined so far: a", lambda: Variables({"a": "1"}).get("b"))


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
    ("1+", "it ends unexpectedly"),
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
    raises(ParameterError, message, lambda: evaluate(text, Fixed()))
