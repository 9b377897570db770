"""What a real robot cell adds to geometry: friction, lag, dead time, noise. Task files set it as [physics].

The only place where these defaults are written.
"""

from __future__ import annotations

from pydantic import Field

from invariantqp.runs.section import NotNegative, Positive, Section


class Physics(Section):
    """Friction, lag, dead time and noise of the MuJoCo plant; of these the ideal plant has the dead time alone."""

    friction: NotNegative = Field(0.3, description="Coulomb coefficient between tool and surface", examples=[0.3])
    hinge_friction: NotNegative = Field(0.3, description="friction torque of a hinge [N m]", examples=[0.3])
    lag: Positive = Field(0.01, description="time constant of the joints' velocity loops [s]", examples=[0.01])
    delay: NotNegative = Field(0.0, description="dead time of the commands [s]", examples=[0.004], lt=10.0)
    armature: NotNegative = Field(
        0.0, description="inertia of each motor's rotor behind its gear [kg m^2]", examples=[0.1]
    )
    force_noise: NotNegative = Field(1.0, description="standard deviation of a measured force [N]", examples=[1.0])
    moment_noise: NotNegative = Field(0.03, description="the same of a measured moment [N m]", examples=[0.03])
    seed: int = Field(0, ge=0, strict=True, description="seed of the noise", examples=[0])
