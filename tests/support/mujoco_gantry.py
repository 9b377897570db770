"""A gantry with position servos, and a ball at its end that rubs on a table, in MuJoCo."""

GANTRY = """
<mujoco>
  <option integrator="implicitfast" timestep="0.001"/>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1" friction="0.3"/>
    <body pos="0 0 0.012">
      <joint name="x" type="slide" axis="1 0 0" range="-1 1" limited="true"/>
      <joint name="y" type="slide" axis="0 1 0" range="-1 1" limited="true"/>
      <joint name="z" type="slide" axis="0 0 1" range="-1 1" limited="true"/>
      <joint name="roll" axis="1 0 0" range="-1 1" limited="true"/>
      <joint name="pitch" axis="0 1 0" range="-1 1" limited="true"/>
      <joint name="yaw" axis="0 0 1" range="-1 1" limited="true"/>
      <geom name="tip" type="sphere" size="0.01" mass="8" friction="0.3"/>
      <site name="tip"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="5e4" kv="1000"/>
    <position joint="y" kp="5e4" kv="1000"/>
    <position joint="z" kp="5e4" kv="1000"/>
    <position joint="roll" kp="500" kv="10"/>
    <position joint="pitch" kp="500" kv="10"/>
    <position joint="yaw" kp="500" kv="10"/>
  </actuator>
</mujoco>
"""
