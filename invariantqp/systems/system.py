"""ScrewSystem: the span of twists, with the functions of this package as methods and properties."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal, overload

from attrs import frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.systems import families, pseudoinverses, stationary
from invariantqp.systems.classification import GibsonHunt, classify
from invariantqp.systems.gram import PrincipalPitches, gram_matrix, pencil
from invariantqp.systems.projectors import DualProjectors, one_rule, projectors_of
from invariantqp.systems.report import SystemReport, describe
from invariantqp.systems.spectra import hyperbolic_singular_values
from invariantqp.systems.subspaces import Subspace


@frozen(init=False, eq=False, repr=False, slots=False)
class ScrewSystem(Subspace):
    """The screw system of (6, m) twists.

        system = ScrewSystem(J)
        system.type, system.principal_pitches, system.pseudoinverse(0.3), system.reciprocal().type

    It is read-only and compared by its twists (`contains` compares spans). Factorisation, type and principal
    pitches are cached. Functions with an argument of type `Subspace` take a ScrewSystem in place
    of twists; several are its methods.

    Attributes:
        twists: (6, m) as given, as columns, dependent or not; (6, 0) is the zero system.
        point: (3,) the own point, which the twists move least [length].
        length: the own length, how far they move it in a radian; `concurrent` if the axes meet there and it has none.
        tolerance: relative error of the twists, 1e-7 by default; smaller numbers count as zero in own coordinates.
        dimension, basis: k, and (6, k) twists that span the system.
    """

    @cached_property
    def pencil(self) -> PrincipalPitches:
        """Principal pitches with screws and condition numbers, and the blind directions."""
        return pencil(self)

    @cached_property
    def type(self) -> GibsonHunt:
        """The Gibson-Hunt type with its moduli; see `gibson_hunt`."""
        return classify(self)

    @property
    def principal_pitches(self) -> Array:
        """(k',) ascending; see `principal_pitches`. Raises `BlindSystem` if no h works."""
        return self._unless_blind().values

    @property
    def principal_screws(self) -> Array:
        """(6, k') one for each principal pitch. Raises `BlindSystem` if no h works."""
        return self._unless_blind().screws

    def _unless_blind(self) -> PrincipalPitches:
        if self.pencil.blind.shape[1]:
            raise BlindSystem(self.pencil.blind)
        return self.pencil

    @property
    def blind_directions(self) -> Array:
        """(6, b) unit translations reciprocal to the whole system for every h; see `blind_directions`."""
        return self.pencil.blind

    gram = gram_matrix
    existence = pseudoinverses.existence
    has_pseudoinverse = pseudoinverses.has_pseudoinverse
    damped_pseudoinverse = pseudoinverses.damped_pseudoinverse
    singular_values = hyperbolic_singular_values
    stationary_point = stationary.stationary_point
    cylindroid = families.cylindroid
    pitch_field = families.pitch_field

    @overload
    def pseudoinverse(
        self,
        h: float | None = ...,
        *,
        complement: ArrayLike | None = ...,
        metric: Any = ...,
        joint_metric: ArrayLike | None = ...,
        return_condition: Literal[False] = ...,
    ) -> Array: ...

    @overload
    def pseudoinverse(
        self,
        h: float | None = ...,
        *,
        complement: ArrayLike | None = ...,
        metric: Any = ...,
        joint_metric: ArrayLike | None = ...,
        return_condition: Literal[True],
    ) -> tuple[Array, float]: ...

    def pseudoinverse(
        self,
        h: float | None = None,
        *,
        complement: ArrayLike | None = None,
        metric: Any = None,
        joint_metric: ArrayLike | None = None,
        return_condition: bool = False,
    ) -> Array | tuple[Array, float]:
        """J^+ P (m, 6), P the projector on the system along Z: J^{+h} for Z = S^{perp h}.

        Args:
            h: pitch [length/rad]; or one of the next two.
            complement: (6, 6-k) twists that span Z.
            metric: (6, 6) positive definite, its (6,) diagonal, or a `CarriedMetric` that has its pose: Z is orthogonal
                to the system in it.
            joint_metric: (m, m) or (m,) positive definite, on joint velocities; None is the identity.
            return_condition: whether to return the condition number too, as the function `pseudoinverse` does.

        Raises:
            NoPseudoinverse: as the function.
            BadInput: Z shares a twist with the system, or not one rule is given.

        Reference: [DS] Theorem 2.2; (6.5) for the other rules. J^+ P with them is ours: it meets (hP1), (hP2) and
            (hP4), and J J^+ P = P takes the place of (hP3).
        """
        both = arrays.flag(return_condition, "return_condition")
        name, value = one_rule(h, complement, metric)
        if name == "h":
            factored = pseudoinverses.invert(self, value, joint_metric)
            return (factored.inverse, factored.condition) if both else factored.inverse
        split = projectors_of(self, (name, value))
        X = pseudoinverses.inverse_along(self, split.motion, joint_metric)
        return (X, self.joint_condition * split.norm) if both else X

    def projectors(
        self, h: float | None = None, *, complement: ArrayLike | None = None, metric: Any = None
    ) -> DualProjectors:
        """P on the system along Z and its dual on wrenches; see `dual_projectors`."""
        return projectors_of(self, one_rule(h, complement, metric))

    @property
    def report(self) -> SystemReport:
        """The system in words; see `describe`."""
        return describe(self)
