"""Cycles of a rotating link with GHM and of a pin that sticks, against programs of their own equations: start and multipliers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_periodic import assert_multipliers

GRAVITY = 9.81

LINK = """! A beam with a GHM term hangs on the pin of a crank that turns.
&scene gravity=0,-9.81 /
&material name='soft' density=1200 young=1e8 ghm_alpha=0.6 ghm_zeta=0.8 ghm_omega=60 /
&section name='bar' shape='rectangle' width=0.02 height=0.01 /
&body name='crank' mass=1 inertia=0.01 angle=0.4 /
&body name='beam' kind='beam' length=0.5 elements=1 material='soft' section='bar' reference='clamped' axial=.false.
  angle=-1.4 position={0.05*cos(0.4)},{0.05*sin(0.4)} /
&joint name='o' type='revolute' body_a='crank' point_a=0,0 /
&joint name='p' type='revolute' body_a='beam' node_a=1 body_b='crank' point_b=0.05,0 /
&spring name='drag' type='torsional' body_a='beam' node_a=1 body_b='ground' stiffness=0 damping=0.02 free_angle=0 /
&history name='w' kind='polynomial' coefficients=12 /
&drive name='m' type='rotation' body_a='crank' history='w' rate=.true. /
&periodic period={2*pi/12} multipliers=3 /
&transient method='rk4' step={2*pi/12/4000} /
"""


class Link:
    """The beam: points of Gauss, the two shapes of its free node, its stiffness by φ2 - φ1 and (φ1 + φ2)/2."""

    crank, spin, alpha, zeta, omega = 0.05, 12.0, 0.6, 0.8, 60.0

    def __init__(self):
        length = 0.5
        points, weights = np.polynomial.legendre.leggauss(4)
        xi = (points + 1) / 2
        self.x, self.mass = length * xi[:, None], (1200 * 2e-4 * length / 2 * weights)[:, None]
        self.shape = np.array([3 * xi**2 - 2 * xi**3, length * (xi**3 - xi**2)])
        self.strain = np.array([[0, 1], [-1 / length, 0.5]])
        self.stiffness = self.strain.T @ (1e8 * 0.02 * 0.01**3 / 12 / length * np.diag([1, 12]))
        self.lever = (self.shape @ (self.mass * self.x))[:, 0]
        self.bending = (self.shape * self.mass[:, 0]) @ self.shape.T

    def rates(self, t, y):
        """Return the rates of (θ, v, r), their rates, z and its rates; y has the shape (10, states)."""
        angle, bent, rate, bending = y[0], self.shape.T @ y[1:3], y[3], self.shape.T @ y[4:6]
        turned, s, c = self.spin * t + 0.4, np.sin(angle), np.cos(angle)
        pin = -self.crank * self.spin**2 * math.cos(turned), GRAVITY - self.crank * self.spin**2 * math.sin(turned)
        along = self.mass * (-(rate**2) * self.x - 2 * rate * bending + c * pin[0] + s * pin[1])
        across = self.mass * (-(rate**2) * bent - s * pin[0] + c * pin[1])
        mass = np.empty((y.shape[1], 3, 3))
        mass[:, 0, 0] = (self.mass * (self.x**2 + bent**2)).sum(0)
        mass[:, 0, 1:] = mass[:, 1:, 0] = self.lever
        mass[:, 1:, 1:] = self.bending
        deformation = self.strain @ y[1:3]
        force = np.empty((3, y.shape[1]))
        force[0] = (bent * along - self.x * across).sum(0) - 0.02 * rate
        force[1:] = -self.shape @ across - self.stiffness @ (deformation + self.alpha * (deformation - y[6:8]))
        acceleration = np.linalg.solve(mass, force.T[:, :, None])[:, :, 0].T
        relaxing = -2 * self.zeta * self.omega * y[8:10] - self.omega**2 * (y[6:8] - deformation)
        return np.concatenate([y[3:6], acceleration, y[8:10], relaxing])


def test_link_with_ghm(run_deck):
    """Floating frame, one element and its GHM term written out anew; central differences of turns by Runge and Kutta's method."""
    run = run_deck(LINK)
    state = np.loadtxt(run.folder / "orbit.txt")[1:, 1]
    start = np.concatenate([state[5:8], state[13:16], state[16:20]])  # behind the crank's and the beam's place
    steps = np.array([1e-4, 1e-5, 1e-4, 1e-3, 1e-3, 1e-2, 1e-5, 1e-5, 1e-3, 1e-3])
    y = start[:, None] + np.hstack([np.zeros((10, 1)), np.diag(steps), -np.diag(steps)])
    h, rates = 2 * math.pi / 12 / 700, Link().rates
    for t in h * np.arange(700):
        a = rates(t, y)
        b = rates(t + h / 2, y + h / 2 * a)
        c = rates(t + h / 2, y + h / 2 * b)
        y = y + h / 6 * (a + 2 * b + 2 * c + rates(t + h, y + h * c))
    assert np.allclose(y[:, 0], start, rtol=1e-6, atol=1e-9)
    assert_multipliers(run, np.linalg.eigvals((y[:, 1:11] - y[:, 11:]) / (2 * steps)))


PIN = """! A sprung block that is shaken; in it a pendulum whose pin sticks twice a period.
&scene gravity=0,-9.81 /
&body name='block' mass=2 inertia=1 /
&body name='pendulum' mass=0.8 inertia=0.012 com=0,-0.25 angle=0.5 /
&joint name='rail' type='prismatic' body_a='block' direction=0 /
&joint name='pin' type='revolute' body_a='pendulum' point_a=0,0 body_b='block' point_b=0,0 friction=0.9 pin_radius=0.16 /
&spring name='k' type='linear' body_a='block' point_a=0,0 point_b=-2,0 stiffness=300 damping=3 free_length=2 /
&history name='h' kind='sine' amplitude=1 frequency={9/(2*pi)} phase=PHASE /
&force name='f' type='force' body='block' fx=12 history='h' /
&sensor name='x' quantity='position' body='block' /
&sensor name='v' quantity='velocity' body='block' /
&sensor name='p' quantity='angle' body='pendulum' /
&sensor name='w' quantity='angular_velocity' body='pendulum' /
&periodic period={2*pi/9} multipliers=6 /
&transient method='rk4' step={2*pi/9/1500} output_step={2*pi/9/50} /
"""


class Pin:
    """The block and its pendulum: slip of either sign, or rest of the pin, between events."""

    block, bob, arm, inertia, limit = 2.0, 0.8, 0.25, 0.012, 0.9 * 0.16

    def __init__(self, phase):
        self.phase = phase

    def forces(self, t, y, sign):
        """Return accelerations, the pin's moment on the pendulum and the largest that friction allows."""
        x, angle, speed, rate = y
        s, c = math.sin(angle), math.cos(angle)
        push = 12 * math.sin(9 * t + self.phase) - 300 * x - 3 * speed
        if sign == 0:
            a = np.array([push / (self.block + self.bob), 0.0])
            moment = self.bob * self.arm * (c * a[0] + s * GRAVITY)
            return a, moment, self.limit * self.bob * math.hypot(a[0], GRAVITY)
        lever = self.bob * self.arm
        mass = np.array([[self.block + self.bob, lever * c], [lever * c, self.inertia + lever * self.arm]])
        load = np.array([[push + lever * s * rate**2, 0.0], [-lever * GRAVITY * s, -sign]])
        a = np.linalg.solve(mass, load)  # without friction, and by a unit of it
        place = np.array([[1, self.arm * c], [0, self.arm * s]]) @ a
        place[:, 0] += self.arm * rate**2 * np.array([-s, c]) + [0, GRAVITY]
        place *= self.limit * self.bob  # moment = |place (1, moment)|
        p, q, r = 1 - place[:, 1] @ place[:, 1], place[:, 0] @ place[:, 1], place[:, 0] @ place[:, 0]
        moment = (q + math.sqrt(q * q + p * r)) / p
        return a @ [1, moment], -sign * moment, moment

    def turn(self, start):
        """Return the state a period later."""
        t, end, y = 0.0, 2 * math.pi / 9, np.array(start)
        sign = int(np.sign(y[3])) if abs(y[3]) > 1e-9 else 0
        y[3] *= abs(sign)

        def leaves(t, y, sign):
            _, moment, limit = self.forces(t, y, 0)
            return sign * y[3] if sign else limit - abs(moment)

        leaves.terminal, leaves.direction = True, -1
        tight = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "events": leaves, "max_step": 0.05}
        while t < end:
            part = solve_ivp(lambda t, y, sign: [*y[2:], *self.forces(t, y, sign)[0]], (t, end), y, args=(sign,), **tight)
            t, y = part.t[-1], part.y[:, -1]
            if part.status == 1 and sign:
                y[3], sign = 0.0, 0
                assert leaves(t, y, sign) > 0
            elif part.status == 1:
                sign = -int(np.sign(self.forces(t, y, 0)[1]))
                y[3] = sign * 1e-14
        return y


@pytest.mark.parametrize("phase", [0.3, 0.84])
def test_pin_that_sticks(run_deck, phase):
    """Four phases a period, from a start that slips and one that rests; central differences of turns with located events."""
    run = run_deck(PIN.replace("PHASE", str(phase)))
    start = np.array([run.history[name][0] for name in ("x.x", "p", "v.x", "w")])
    pin = Pin(phase)
    assert np.allclose(pin.turn(start), start, atol=3e-7)
    free = 4 if phase < 0.5 else 3
    moves = np.diag([1e-5, 1e-5, 1e-4, 1e-4])[:free]
    columns = [(pin.turn(start + d) - pin.turn(start - d))[:free] / (2 * d.max()) for d in moves]
    expected = np.linalg.eigvals(np.array(columns).T)
    assert_multipliers(run, expected[np.abs(expected) > 1e-6])
