"""Decks of studies that several tests use."""

ARGUMENT = """&body name='b' mass=1 inertia=1 position=1,0 /
&joint name='g' type='prismatic' body_a='b' /
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
&parameter name='k' value=9 /
&history name='s' kind='polynomial' coefficients=0,{-k} argument='x.x' /
&force name='f' body='b' fx=1 history='s' /
&transient t_end=1 method='rk4' step=1e-3 /
"""  # a force that depends on a sensor
