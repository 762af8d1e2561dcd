"""Compute the compliance H B^-1 H^T: the gap (or gap rate) changes per unit load on the pairs."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp

from delam_fem.engines.petsc import linear_algebra
from delam_fem.model.distributed import DistributedOperators
from delam_fem.numerics.arrays import FloatArray, IntArray

ROOM = 100_000
"""Number of entries up to which blocks of pairs are kept: contact returns to the same pairs."""


class Responding(Protocol):
    """An object that computes the response of all gaps to a load on one pair; see dynamics.py."""

    operators: DistributedOperators

    def response(self, factor: linear_algebra.Factor, pair: int) -> FloatArray:
        """Return H x, where x is the factor's solution for a unit load on a pair, (n_pairs,)."""


class LazyCompliance:
    """H B^-1 H^T of a factorised matrix B; each column is computed when it is first needed."""

    def __init__(self, dynamics: Responding, factor: linear_algebra.Factor) -> None:
        """Prepare the computation of columns; compute none yet.

        Args:
            dynamics: object that owns H and computes responses.
            factor: factor of B.
        """
        n = dynamics.operators.n_pairs
        self._dynamics, self._factor = dynamics, factor
        self._columns = np.empty((0, n))  # one below the other, in the order of their computation
        self._place = np.full(n, -1)
        self._n_known = 0
        self._blocks: dict[bytes, FloatArray] = {}
        self._room = ROOM

    def _require(self, pairs: IntArray) -> None:
        missing = pairs[self._place[pairs] < 0]
        if not missing.size:
            return
        room = self._n_known + missing.size
        if room > len(self._columns):
            more = np.empty((max(room, 2 * self._n_known) - self._n_known, self._place.size))
            self._columns = np.concatenate([self._columns[: self._n_known], more])
        for k in missing.tolist():
            response = self._dynamics.response(self._factor, k)
            self._columns[self._n_known] = self._factor.scale * response
            self._place[k] = self._n_known
            self._n_known += 1

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return the diagonal entries of some pairs, shape (k,)."""
        self._require(pairs)
        return self._columns[self._place[pairs], pairs]

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of some pairs, shape (k, k)."""
        key = pairs.tobytes()
        found = self._blocks.get(key)
        if found is None:
            self._require(pairs)
            found = self._columns[self._place[pairs], pairs[:, None]]
            self._room -= pairs.size**2
            if self._room < 0:
                self._blocks, self._room = {}, ROOM
            self._blocks[key] = found
        return found


class LumpedCompliance:
    """H D^-1 H^T of the lumped mass D; pairs of different nodes do not influence one another."""

    def __init__(self, operators: DistributedOperators) -> None:
        """Compute the matrix, which is sparse (collective)."""
        H, comm = operators.gap_matrix, operators.comm
        own = (H @ sp.diags(1.0 / operators.require_lumped_mass()) @ H.T).tocsr()
        self._W = own if comm.size == 1 else sum(comm.allgather(own), 0 * own)
        self._diagonal = self._W.diagonal()

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return the diagonal entries of some pairs, shape (k,) [1/kg]."""
        return self._diagonal[pairs]

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of some pairs, shape (k, k) [1/kg]."""
        return np.asarray(self._W[pairs][:, pairs].toarray())
