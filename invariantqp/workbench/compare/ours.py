"""Our law, by the engine and by its definition in Python."""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.arms import chain_of
from invariantqp.workbench.compare.method import OTHER_SETTINGS, OURS, LoopSpec, Method, MethodSetting
from invariantqp.workbench.runs.controllers import our_controller
from invariantqp.workbench.runs.taskfile import LawSpec, law_options


class Ours:
    """The law of this library as shipped: a `Controller` with its defaults."""

    def __init__(self, spec: LoopSpec) -> None:
        self.robot = chain_of(spec)
        self.controller = our_controller(self.robot, LawSpec.model_validate(spec.law))

    def target(self, pose: Array, feedforward: Array | None) -> Any:
        """A target object; a pose that is not finite as it is."""
        del feedforward
        return self.robot.target(pose) if np.isfinite(pose).all() else pose

    def step(self, q: Array, target: Any, feedforward: Array | None, previous: Array) -> Array:
        """One tick."""
        del previous  # the controller has them
        return self.controller.step(q, target, feedforward).velocity


class ByDefinition(Ours):
    """The same by velocity/definition.py, with DAQP, in the same loop."""

    def __init__(self, spec: LoopSpec) -> None:
        self.robot = chain_of(spec)
        options = law_options(self.robot, LawSpec.model_validate(spec.law))
        self.controller = Controller(self.robot, **options, backend="daqp")


SETTING = MethodSetting("in the null space, while the tool moves", "in the law", "none", point="given, with length")
METHODS = [
    Method(OURS, "ours", Ours, SETTING),
    Method("the definition", OTHER_SETTINGS, ByDefinition, SETTING, slow=True),
]
