"""The state of a problem in compiled code, with the Python interface for recorder and engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import loop, state, system
from delam_fem.engines.compiled.handle import packed
from delam_fem.engines.compiled.state import CONTACT_DAMPED, DISSIPATED, LawNumbers
from delam_fem.engines.compiled.system import Problem, StepNumbers
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.simulation.energy import Energies


class CompiledStepper:
    """A problem, its scheme, its law and its state.

    Attributes:
        system, law, memory: what compiled functions work on; the system is that of fine steps.
        address: where the table of this `Problem` lies.
        unknowns: what the internal numbers of the fields are.
        seen_u: m_b·u, c_b·u, k_b·u and the probes of u at the last `observe`, shape
            (3 + n_probes,).
        seen_v: the probes of v at the last `observe`, shape (n_probes,).
    """

    def __init__(
        self, operators: Operators, schemes: Sequence[StepNumbers], law: LawNumbers
    ) -> None:
        """Factorise the matrices; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            schemes: the time integration with coarse, middle and fine steps.
            law: the contact law.
        """
        self.law, self._has_acceleration = law, schemes[-1].has_acceleration
        built = [system.build(operators, scheme) for scheme in schemes]
        coarse, middle, fine = (one._replace(coarseness=2 - k) for k, (one, _) in enumerate(built))
        self.system, self.unknowns = fine, built[-1][1]
        self.memory = state.memory(self.system.size, operators.n_pairs, self.system.n_probes)
        corner = np.array(operators.base.corner, dtype=float)
        self._problem = Problem(coarse, middle, fine, law, self.memory, corner)
        self._table = packed(self._problem)
        self.address = int(self._table.ctypes.data)
        self.seen_u, self.seen_v = self.memory.seen_u, self.memory.seen_v

    @property
    def dissipated(self) -> float:
        """Energy that damping has taken from the free dofs so far [J]."""
        return float(self.memory.totals[DISSIPATED])

    @dissipated.setter
    def dissipated(self, value: float) -> None:
        self.memory.totals[DISSIPATED] = value

    @property
    def contact_damped(self) -> float:
        """Energy that contact dampers have taken so far [J]."""
        return float(self.memory.totals[CONTACT_DAMPED])

    @contact_damped.setter
    def contact_damped(self, value: float) -> None:
        self.memory.totals[CONTACT_DAMPED] = value

    @property
    def resting(self) -> BoolArray:
        """Pairs at rest, shape (n_pairs,)."""
        return self.memory.resting.astype(np.bool_)

    def observe(self) -> None:
        """Update `seen_u` and `seen_v` from the current state."""
        loop.observe(self.address)

    def energies(self) -> Energies:
        """Return the energies of the whole system, base included, in the fixed frame [J]."""
        loop.store_energies(self.address)
        return Energies(*self.memory.stored.tolist())

    def state(self) -> FloatArray:
        """Return (u, v, a) of all dofs, with a from the equation of motion, shape (3, n)."""
        self.renew_acceleration()
        return self.unknowns.outward(self._fields())

    def internal(self) -> FloatArray | None:
        """Return the fields in modes, shape (3, size); None if the unknowns are the dofs."""
        return self._fields().copy() if self.system.is_modal else None

    def restore(
        self, motion: FloatArray, resting: BoolArray, internal: FloatArray | None = None
    ) -> None:
        """Take over (u, v, a), shape (3, n), and the pairs at rest.

        The numbers of `internal` count if they are those of this motion; they have its round-off.
        """
        self.memory.X[:] = 0.0
        fields = self._fields()
        if internal is not None and internal.shape == fields.shape and self.system.is_modal:
            is_own = np.array_equal(self.unknowns.outward(internal), motion)
        else:
            is_own = False
        fields[:] = internal if is_own else self.unknowns.inward(motion)
        self.memory.resting[:] = resting
        if self._has_acceleration:  # the θ-scheme has no springs
            loop.list_springs(self.address)

    def renew_acceleration(self) -> None:
        """Compute a from the equation of motion; do nothing with the θ-scheme, which has no a."""
        if self._has_acceleration:
            loop.renew(self.address)

    def _fields(self) -> FloatArray:
        """Return u, v, a in internal order, shape (3, size)."""
        size = self.system.size
        return self.memory.X[: (lk.A + 1) * size].reshape(3, size)
