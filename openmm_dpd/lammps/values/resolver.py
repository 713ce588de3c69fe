"""Values of the names in a formula or a column at one moment."""

import math

import numpy as np

from ...base.errors import ParameterError
from ..files.data_file import JOINED
from ..language import arguments as read
from ..language.expressions import ATOM_VALUES, Formula, evaluate
from ..language.lexer import substitute
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import FixValues
from .compute_spec import check_place, reference
from .computes import COMPUTES, average_of, check_bead_word, check_value, compute_of, is_of_beads
from .per_bead import BEAD_WORDS, check_carried
from .words import WORDS


class Resolver(DeckMoment):
    """A moment at which names have values, for :func:`~openmm_dpd.lammps.language.expressions.evaluate` and for output."""

    def formula(self, text: str) -> float:
        """Value of a formula."""
        return evaluate(text, self)

    def substituted(self, text: str) -> str:
        """Text with ``$`` substituted."""
        return substitute(text, self._text, self.formula)

    def _text(self, name: str) -> str:
        """The text that replaces ``${name}``."""
        if self.state.variables.get(name).style != "vector":
            return self.state.variables.text(name, self.formula)
        return f"[{','.join(f'{value:.15g}' for value in self.vector(f'v_{name}'))}]"

    def thermo(self, word: str) -> float:
        """Value of a thermo word."""
        if word not in WORDS:
            raise ParameterError(f"there is no thermo word '{word}'; known are {', '.join(WORDS)}{read.near(word, WORDS)}")
        return float(WORDS[word].value(self))

    def variable(self, name: str, index: int | None = None) -> float:
        """Value of ``v_name``, or of ``v_name[index]`` of a vector, within a formula."""
        if index is None:
            return self.state.variables.operand(name, self.formula)
        values = self.vector(f"v_{name}")
        if not 1 <= index <= len(values):
            raise ParameterError(f"v_{name}[{index}] is out of range: the vector has {len(values)} values")
        return float(values[index - 1])

    def vector(self, word: str) -> np.ndarray:
        """All values of ``v_name``, a vector-style variable, of ``c_id`` or ``f_id``, or of a column of its table, such as ``f_id[2]``."""
        kind, name, indices = reference(word)
        if kind == "v":
            return self.state.variables.values(name, "vector", lambda text: evaluate_vector(text, self))
        if kind == "c":
            return self.compute_vector(name, *indices)
        found = average_of(self.state, name)
        if not indices or isinstance(found, FixValues) or len(found.shape) < 2:
            return self.fix_vector(name)
        found.check_index(1, *indices)
        return found.values[:, indices[0] - 1]

    def variable_alone(self, name: str) -> float:
        """Value of ``v_name`` outside formulas."""
        return self.state.variables.value(name, self.formula)

    def compute(self, name: str, index: int | None = None, column: int | None = None) -> float:
        """Value of ``c_name``, ``c_name[index]`` or ``c_name[index][column]``, not normalised."""
        if column is None and self.is_bead_compute(name):
            return self._of_bead(name, index)
        compute, spec = check_value(self.state, name, index, column)
        if index is None:
            assert spec.scalar is not None
            return float(spec.scalar(self, compute))
        if spec.array is not None and spec.tabled(compute):
            return float(spec.array(self, compute)[check_place(compute, spec, index, column)])
        assert spec.vector is not None
        values = spec.vector(self, compute)
        if not 1 <= index <= len(values):
            raise ParameterError(f"c_{name}[{index}] is out of range: compute {compute.style} has {len(values)} values")
        return float(values[index - 1])

    def compute_vector(self, name: str, column: int | None = None) -> np.ndarray:
        """All values of ``c_name``, or the column ``c_name[column]`` of its table.  ParameterError if it has none."""
        compute, spec = compute_of(self.state, name)
        if spec.array is not None and spec.tabled(compute) and column is not None:
            return spec.array(self, compute)[:, column - 1]
        if spec.vector is None:
            raise ParameterError(f"compute {name} (style {compute.style}) has no vector")
        return spec.vector(self, compute)

    def bead_compute(self, name: str, column: int | None) -> np.ndarray:
        """(N,) values of ``c_name`` or ``c_name[column]``, a compute with per-bead values."""
        compute, spec = compute_of(self.state, name)
        if spec.per_bead is None:
            raise ParameterError(f"compute {name} (style {compute.style}) has no values of single beads")
        values = spec.per_bead(self, compute)
        if column is not None and (values.ndim == 1 or column > values.shape[1]):  # it was redefined
            raise ParameterError(f"compute {name} (style {compute.style}) no longer has a column {column}")
        return values if column is None else values[:, column - 1]

    def local_values(self, word: str) -> np.ndarray:
        """Values of ``c_name`` or ``c_name[column]`` for each bond, angle or dihedral of a compute."""
        _, name, indices = reference(word)
        compute, spec = compute_of(self.state, name)
        assert spec.local is not None
        return spec.local(self, compute)[:, indices[0] - 1 if indices else 0]

    def _of_bead(self, name: str, bead: int | None) -> float:
        """Value of a compute for the bead with the id ``bead``."""
        if bead is None:
            raise ParameterError(f"compute {name} has values of single beads; use c_{name}[id], compute reduce or fix ave/chunk")
        values = self.bead_compute(name, None)
        if values.ndim > 1:
            raise ParameterError(f"compute {name} has {values.shape[1]} values per bead; c_id[id] requires a compute with one")
        return float(values[self._bead(bead, f"c_{name}")])

    def _bead(self, identity: int, what: str) -> int:
        """Index of the bead with an id."""
        try:
            return int(self.state.atoms.index_of(np.array([identity]))[0])
        except KeyError:
            raise ParameterError(f"{what}[{identity}]: there is no bead with the id {identity}") from None

    def number(self, word: str) -> float:
        """Value of ``c_id``, ``f_id`` or ``v_name``, possibly with indices, outside formulas."""
        kind, name, indices = reference(word)
        if kind == "v":
            return self.variable(name, *indices) if indices else self.variable_alone(name)
        return self.fix(name, *indices) if kind == "f" else self.compute(name, *indices)

    def fix(self, name: str, index: int | None = None, column: int | None = None) -> float:
        """Value of ``f_name``, ``f_name[index]`` or ``f_name[index][column]``: the last average, 0 before the first."""
        found, indices = average_of(self.state, name), [k for k in (index, column) if k is not None]
        if isinstance(found, FixValues):
            found.check_index(*indices)
            return float(self._acted(name)[indices[0] if indices else 0])
        return found.value(*indices)

    def fix_vector(self, name: str) -> np.ndarray:
        """All values of ``f_name``.  ParameterError if it has no vector."""
        average = average_of(self.state, name)
        if isinstance(average, FixValues):
            return np.array(self._acted(name)[1:])
        if np.ndim(getattr(average, "values", 0.0)) != 1:
            raise ParameterError(f"there is no fix '{name}' with a vector")
        return average.values

    def _acted(self, name: str) -> list[float]:
        acted = self.need("acted")
        if name not in acted:
            raise ParameterError(f"f_{name}: the fix has not acted yet; it acts in the next run")
        return acted[name]

    # -- values of all beads ----------------------------------------------------------------------------
    def bead_values(self, word: str) -> np.ndarray:
        """(N,) values of a word of :data:`BEAD_WORDS`, ``c_id``, ``c_id[column]``, or ``v_name`` of an atom-style variable."""
        if word.startswith("v_"):
            return np.asarray(self.bead_variable(word[2:]))
        if word.startswith("c_"):
            _, name, indices = reference(word)
            return self.bead_compute(name, *indices or (None,))
        if word.startswith("f_"):
            _, name, indices = reference(word)
            return self.state.fixes[name].parameters["reader"].of_beads(self.state, *indices or (None,))
        return BEAD_WORDS[word](self)

    def bead_variable(self, name: str) -> np.ndarray | float:
        """Value of ``v_name``: a number, or (N,) values if it is an atom-style variable."""
        variable = self.state.variables.get(name)
        if variable.style == "atomfile":
            return np.array([variable.table.get(number, 0.0) for number in self.state.atoms.ids])
        if variable.style != "atom":
            return self.variable(name)
        return self.state.variables.values(name, "atom", lambda text: evaluate_beads(text, self, len(self.state.atoms)))

    def is_bead_compute(self, name: str) -> bool:
        """Whether a compute has per-bead values."""
        return name in self.state.computes and COMPUTES[self.state.computes[name].style].per_bead is not None

    def group(self, function: str, arguments: list[str]) -> float:
        """Value of a group function such as ``count(group)``, or of a function of labels such as ``label2type(atom,W)``."""
        if function in ("label2type", "is_typelabel"):
            return self._label(function, *arguments)
        mask = self._members(function, arguments)
        if function == "count":
            return float(mask.sum())
        if function == "charge":
            check_carried(self.state, "q")
            return float(self.state.atoms.charges[mask].sum())
        masses = self.state.bead_masses()[mask]
        if function == "mass":
            return float(masses.sum()) / self.units.mass
        if function == "ke":
            return self.kinetic_of(masses, self.velocities[mask]) / self.units.energy
        if function == "bound":
            return self._bound(self.folded[0][mask], arguments)
        return float(self.state.mass_average(self.velocities if function == "vcm" else self.unwrapped, mask)["xyz".index(arguments[1])])

    def _label(self, function: str, *arguments: str) -> float:
        """The number of the type with a label; of ``is_typelabel`` whether there is one."""
        if len(arguments) != 2:
            raise ParameterError(f"expected {function}({'|'.join(('atom', *JOINED))},label), not {function}({','.join(arguments)})")
        what, label = arguments
        labels = self.state.labels.get(read.choice(what, f"the first argument of {function}", ("atom", *JOINED)), {})
        return float(label in labels if function == "is_typelabel" else read.known(labels, label, f"label of {what} types"))

    def _members(self, function: str, arguments: list[str]) -> np.ndarray:
        """Mask of the beads that a group function uses, after a check of its arguments."""
        needed = 2 if function in ("xcm", "vcm", "bound") else 1
        if not needed <= len(arguments) <= needed + 1:
            raise ParameterError(f"{function} takes {needed} argument(s) and perhaps a region, not {len(arguments)}")
        if function in ("xcm", "vcm") and arguments[1] not in ("x", "y", "z"):
            raise ParameterError(f"the second argument of {function} is x, y or z, not '{arguments[1]}'")
        mask = self.state.group(arguments[0])
        if len(arguments) > needed:
            mask = mask & self.region(arguments[-1]).contains(self.folded[0])
        return mask

    def _bound(self, positions: np.ndarray, arguments: list[str]) -> float:
        word = arguments[1]
        if len(word) != 4 or word[0] not in "xyz" or word[1:] not in ("min", "max"):
            raise ParameterError(f"the second argument of bound is xmin, xmax, ymin ..., not '{word}'")
        column = positions[:, "xyz".index(word[0])]  # of no beads as in LAMMPS
        return float(column.min(initial=1e20) if word[1:] == "min" else column.max(initial=-1e20))

    def atom(self, quantity: str, bead: int) -> float:
        """Value of the bead with this id."""
        atoms, index = self.state.atoms, self._bead(bead, quantity)
        integers = {"id": atoms.ids, "type": atoms.types}
        return float(integers[quantity][index] if quantity in integers else BEAD_WORDS[quantity](self)[index])

    def call(self, function: str, arguments: list[float]) -> float:
        """Value of a function that depends on the step or on random numbers."""
        if function in ("random", "normal"):
            if arguments[2] < 1 or arguments[2] != int(arguments[2]):
                raise ParameterError(f"the seed of {function} must be a whole number of at least 1, not {arguments[2]:g}")
            # as in LAMMPS, all formulas share one generator, seeded by the first that draws
            generator = self.state.generators.setdefault("formulas", np.random.default_rng(int(arguments[2])))
            return float((generator.uniform if function == "random" else generator.normal)(arguments[0], arguments[1]))
        if self.window is None:
            raise ParameterError(f"the function {function} can only be used during a run")
        if function == "ramp":
            length = self.window.end - self.window.begin
            done = (self.step - self.window.begin) / length if length else 0.0
            return arguments[0] + (arguments[1] - arguments[0]) * done
        elapsed = (self.step - self.window.begin) * self.state.timestep / self.units.time
        if function == "vdisplace":
            return arguments[0] + arguments[1] * elapsed
        phase = 2 * math.pi * elapsed / arguments[2]
        return arguments[0] + arguments[1] * (math.sin(phase) if function == "swiggle" else 1 - math.cos(phase))


def present(state: DeckState) -> Resolver:
    """A deck between two commands, with the measurement of its present step if there is one."""
    sample = state.last_sample
    return Resolver(state, sample if sample is not None and sample.step == state.step else None)


# -- atom-style formulas ---------------------------------------------------------------------------------------------------------
class _BeadFormula(Formula):
    """A formula evaluated for every bead."""

    kind = "beads"
    resolver: Resolver

    def name(self, token: str):
        if token in ("random", "normal"):
            self.fail(f"{token} is only supported in equal-style variables")
        if token.startswith("v_") and self.peek()[1] != "[":
            return self.resolver.bead_variable(token[2:])
        if token.startswith("c_") and self.resolver.is_bead_compute(token[2:]):
            return self._of_compute(token[2:])
        if token.startswith("f_") and is_of_beads(self.resolver.state, token):
            index = self.index()
            word = token if index is None else f"{token}[{index}]"
            check_bead_word(self.resolver.state, word)
            return self.resolver.bead_values(word)
        following = self.peek()[1]
        if following == "(" or (following == "[" and token in ATOM_VALUES):
            return super().name(token)
        return BEAD_WORDS[token](self.resolver) if token in BEAD_WORDS else super().name(token)

    def _of_compute(self, name: str):
        index = self.index()
        whole = self.resolver.bead_compute(name, None)
        if index is None or whole.ndim == 1:
            if whole.ndim > 1:
                self.fail(f"compute {name} has {whole.shape[1]} values per bead; use c_{name}[1] and so on")
            return whole if index is None else self.resolver.compute(name, index)
        if not 1 <= index <= whole.shape[1]:
            self.fail(f"c_{name}[{index}] is out of range: compute {name} has {whole.shape[1]} values per bead")
        return whole[:, index - 1]


class _VectorFormula(Formula):
    """A formula evaluated for every value of vectors."""

    kind = "beads"
    resolver: Resolver

    def unary(self):
        return np.array(self.listed(lambda: self.binary(0), "[]")) if self.peek()[1] == "[" else super().unary()

    def name(self, token: str):
        whole = token[:2] in ("c_", "f_") or (token[:2] == "v_" and self.resolver.state.variables.get(token[2:]).style == "vector")
        return self.resolver.vector(token) if whole and self.peek()[1] != "[" else super().name(token)


def evaluate_vector(text: str, resolver: Resolver) -> np.ndarray:
    """(n,) values of a vector-style formula such as ``[1,2,3]`` or ``2*v_name``; ParameterError as :func:`evaluate` raises it."""
    formula = _VectorFormula(text, resolver)
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            return np.atleast_1d(np.asarray(formula.value(), dtype=np.float64))
    except FloatingPointError as error:
        raise ParameterError(f"cannot evaluate the formula '{text}': {error}") from None


def evaluate_beads(text: str, resolver: Resolver, n: int) -> np.ndarray:
    """(n,) values of an atom-style formula such as ``0.5*mass*(vx^2+vy^2)`` for n beads.  ParameterError for the same reasons as
    :func:`evaluate`, for any of the beads."""
    formula = _BeadFormula(text, resolver)
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            return np.broadcast_to(np.asarray(formula.value(), dtype=np.float64), (n,))
    except FloatingPointError as error:
        raise ParameterError(f"cannot evaluate the formula '{text}': {error}") from None
