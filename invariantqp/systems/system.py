"""ScrewSystem: a set of twists and what can be asked of it, as the methods of one value."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal, overload

from attrs import frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.classification import GibsonHunt, classify
from invariantqp.systems.families import Cylindroid, PitchField, cylindroid_of, pitch_field_of
from invariantqp.systems.gram import Parts, PrincipalPitches, gram, parts_of, pencil
from invariantqp.systems.projectors import DualProjectors, one_rule, projectors_of
from invariantqp.systems.pseudoinverses import Existence, conditions_of, damped, factors, inverse_along, invert
from invariantqp.systems.report import SystemReport, report_on
from invariantqp.systems.spectra import HyperbolicSpectrum, singular_values_of
from invariantqp.systems.stationary import StationaryPoint, stationary
from invariantqp.systems.subspaces import Subspace


@frozen(init=False, eq=False, repr=False, slots=False)
class ScrewSystem(Subspace):
    """The screw system of (6, m) twists.

        system = ScrewSystem(J)
        system.type, system.principal_pitches, system.pseudoinverse(0.3), system.reciprocal().type

    It is a value: read-only, compared by its twists (`contains` compares what they span). The factorisation, the split
    into screws and translations, the type and the principal pitches are computed at first use and kept. Functions such
    as `pseudoinverse(J, h)` are short spellings of its methods.

    Attributes:
        twists: (6, m) as given, as columns, dependent or not; (6, 0) is the zero system.
        point: (3,) the own point, which the twists move least [length].
        length: the own length, how far they move it in a radian; `concurrent` if the axes meet there and it has none.
        tolerance: relative error of the twists, 1e-7 by default: what is smaller counts as zero in own coordinates.
        dimension, basis: k, and (6, k) twists that span the system.
    """

    @cached_property
    def parts(self) -> Parts:
        """The split into screws and translations in own coordinates; of the reciprocal for more than 3 dimensions."""
        if self.dimension in (0, 6):
            raise BadInput("J", f"a {self.dimension}-system", "a system of 1 to 5 dimensions")
        return parts_of(self)

    @cached_property
    def pencil(self) -> PrincipalPitches:
        """Principal pitches with screws and condition numbers, and the blind directions."""
        return pencil(self, None if self.dimension in (0, 6) else self.parts)

    @cached_property
    def type(self) -> GibsonHunt:
        """The Gibson-Hunt type with its moduli; see `gibson_hunt`."""
        return classify(self)

    @property
    def principal_pitches(self) -> Array:
        """(k',) ascending; see `principal_pitches`. Raises `BlindSystem` where no h works."""
        return self._seen().values

    @property
    def principal_screws(self) -> Array:
        """(6, k') one for each principal pitch. Raises `BlindSystem` where no h works."""
        return self._seen().screws

    def _seen(self) -> PrincipalPitches:
        if self.pencil.blind.shape[1]:
            raise BlindSystem(self.pencil.blind)
        return self.pencil

    @property
    def blind_directions(self) -> Array:
        """(6, b) unit translations that no pitch form sees; see `blind_directions`."""
        return self.pencil.blind

    def gram(self, h: float) -> Array:
        """G_h = J'Q_h J (m, m) [length]."""
        return gram(self, arrays.number(h, "h", "a pitch, finite or inf", infinite=True))

    def existence(self, h: float) -> Existence:
        """The three conditions of Theorem 3.1 at a pitch, with the condition number of J^{+h}."""
        return conditions_of(self, h)

    def has_pseudoinverse(self, h: float) -> bool:
        """Whether J^{+h} can be computed to three digits."""
        return factors(self, finite_pitch(h)).exists

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
            complement: (6, 6-k) twists that span Z, which the joint velocities leave out.
            metric: (6, 6) positive definite, its (6,) diagonal, or a `CarriedMetric` that has its pose: Z is orthogonal
                to the system in it.
            joint_metric: (m, m) or (m,) positive definite, on joint velocities; None is the identity.
            return_condition: whether to return the condition number too, as the function `pseudoinverse` does.

        Raises:
            NoPseudoinverse: as the function; BadInput: Z shares a twist with the system, or not one rule is given.

        Reference: [DS] Theorem 2.2; (6.5) for the other rules. J^+ P with them is ours: it meets (hP1), (hP2) and
            (hP4), and J J^+ P = P takes the place of (hP3).
        """
        both = arrays.flag(return_condition, "return_condition")
        name, value = one_rule(h, complement, metric)
        if name == "h":
            found = invert(self, value, joint_metric)
            return (found.inverse, found.condition) if both else found.inverse
        split = projectors_of(self, (name, value))
        X = inverse_along(self, split.motion, joint_metric)
        return (X, self.joint_condition * split.norm) if both else X

    def damped_pseudoinverse(self, h: float, damping: float, *, joint_metric: ArrayLike | None = None) -> Array:
        """V diag(mu / (mu^2 + damping^2)) V'J'Q_h (m, 6), for every h; see `damped_pseudoinverse`."""
        return damped(self, h, damping, joint_metric)

    def singular_values(self, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicSpectrum:
        """Hyperbolic singular values; see `hyperbolic_singular_values`."""
        return singular_values_of(self, h, joint_metric)

    def stationary_point(self, twist: ArrayLike, h: float) -> StationaryPoint:
        """J^{+h} s and the error there; see `stationary_point`."""
        return stationary(self, arrays.twist(twist), h)

    def projectors(
        self, h: float | None = None, *, complement: ArrayLike | None = None, metric: Any = None
    ) -> DualProjectors:
        """P on the system along Z and its dual on wrenches; see `dual_projectors`."""
        return projectors_of(self, one_rule(h, complement, metric))

    def cylindroid(self) -> Cylindroid:
        """Pitch and axis of every screw of a 2-system; see `cylindroid`."""
        return cylindroid_of(self)

    def pitch_field(self) -> PitchField:
        """Pitch and axis of every screw of a 3-system; see `pitch_field`."""
        return pitch_field_of(self)

    @property
    def report(self) -> SystemReport:
        """The system in words; see `describe`."""
        return report_on(self)
