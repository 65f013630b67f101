"""Random loops of one controller beside what they do not move, and what is right about them, by dense matrices of numpy.

`Loop` has the deck of a scene, its poles, and its open loop as a function of s. The plant has the modes m x'' + c x' + k x = b u
with the sensed sum of g x or of g x'; the controller is a PID with filter and Padé delay of order 3.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.optimize import brentq


def bending(elements, length, stiffness, mass):
    """Return stiffness and mass matrix of a bent beam, (v, turn) of each node, from Hermite's cubics."""
    h = length / elements
    unit = np.diag([1, h, 1, h])
    k = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    m = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    whole_k, whole_m = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        at = np.ix_(range(2 * e, 2 * e + 4), range(2 * e, 2 * e + 4))
        whole_k[at] += stiffness / h**3 * unit @ k @ unit
        whole_m[at] += mass * h / 420 * unit @ m @ unit
    return whole_k, whole_m


@dataclass
class Loop:
    """One loop.

    Attributes:
        deck: the scene, without analyses
        mass, damping, stiffness: of the plant's modes
        acts, sees: b and g
        rate: the sensed quantity is g x'
        law: kp, ki, kd, filter, delay
    """

    deck: str
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    acts: np.ndarray
    sees: np.ndarray
    law: dict
    rate: bool = False

    def pid(self, s):
        """Return output over error at s, the delay included."""
        law = {"ki": 0.0, "kd": 0.0, "filter": 0.0, "delay": 0.0, **self.law}
        x = law["delay"] * s
        late = (120 - x * (60 - x * (12 - x))) / (120 + x * (60 + x * (12 + x)))
        return late * (law["kp"] + law["ki"] / s + law["kd"] * s / (law["filter"] * s + 1))

    def open(self, s):
        """Return the open loop at some s."""
        s = np.atleast_1d(np.asarray(s, complex))[:, None]
        t = s**2 * self.mass + s * self.damping + self.stiffness
        motion = (self.acts * self.sees / np.where(t == 0, 1e-200, t)).sum(axis=1)
        return self.pid(s[:, 0]) * motion * (s[:, 0] if self.rate else 1.0)

    def poles(self, gain=1.0):
        """Return all poles with the loop closed by a gain: eigenvalues of the states x, x', those of delay, integral and filter."""
        law = {"ki": 0.0, "kd": 0.0, "filter": 0.0, "delay": 0.0, **self.law}
        n, late, smooth = len(self.acts), law["delay"], law["filter"]
        first = 2 * n + 3 * bool(late)
        unit = np.eye(first + bool(law["ki"]) + bool(smooth))
        a = np.zeros_like(unit)
        a[:n] = unit[n : 2 * n]
        y = self.sees @ unit[n : 2 * n] if self.rate else self.sees @ unit[:n]
        slope = np.zeros(len(unit)) if self.rate else self.sees @ unit[n : 2 * n]
        if late:
            z = unit[2 * n : 2 * n + 3]
            a[2 * n : 2 * n + 3] = np.array([z[1], z[2], y - 120 * z[0] - 60 * z[1] - 12 * z[2]]) / late
            y, slope = 240 * z[0] + 24 * z[2] - y, 240 * a[2 * n] + 24 * a[2 * n + 2] - slope
        out = -law["kp"] * y
        if law["ki"]:
            a[first] = -law["ki"] * y
            out = out + unit[first]
        if smooth:
            a[-1] = -(y + unit[-1]) / smooth
            out = out - law["kd"] / smooth * (y + unit[-1])
        else:
            out = out - law["kd"] * slope
        force = -self.stiffness[:, None] * unit[:n] - self.damping[:, None] * unit[n : 2 * n] + gain * np.outer(self.acts, out)
        a[n : 2 * n] = force / self.mass[:, None]
        poles = np.linalg.eigvals(a)
        return poles[np.argsort(np.abs(poles))]

    def grid(self):
        """Return frequencies that show every pole, of the open loop and of the closed one."""
        lists = np.concatenate([self.poles(0.0), self.poles()])
        scale = np.abs(lists[np.abs(lists) > 1e-9 * np.abs(lists).max()])
        omega = [np.geomspace(1e-4 * scale.min(), 1e2 * scale.max(), 6000)]
        for pole in lists:
            steps = np.abs(pole) * np.geomspace(1e-13, 2, 300)
            omega += [np.abs(pole.imag) - steps, np.abs(pole.imag) + steps]
        omega = np.concatenate(omega)
        return np.unique(omega[omega >= 1e-4 * scale.min()])

    def margins(self):
        """Return all gains at which the open loop is real and negative, with frequency, and all lags to -1 where its size is 1."""
        omega = self.grid()
        loop = self.open(1j * omega)

        def crossings(of):
            at = np.flatnonzero(np.sign(of(loop[:-1])) * np.sign(of(loop[1:])) < 0)
            found = []
            for k in at:
                root = brentq(lambda w: of(self.open(1j * w))[0], omega[k], omega[k + 1], xtol=1e-300, rtol=1e-14)
                value = self.open(1j * root)[0]
                if 0.3 * min(abs(loop[k : k + 2])) < abs(value) < 3 * max(abs(loop[k : k + 2])):  # neither a pole nor a zero
                    found.append((root, value))
            return found

        gains = [(-1 / value.real, root) for root, value in crossings(np.imag) if value.real < 0]
        rest, half = self.open(1j * omega[0] * np.array([1.0, 0.5]))
        if abs(rest - half) < 1e-3 * abs(half) and half.real < 0:
            gains.append((-1 / half.real, 0.0))
        lags = [(np.degrees(np.angle(-value)) % 360, root) for root, value in crossings(lambda x: np.abs(x) - 1)]
        return gains, lags

    def encircled(self):
        """Return how many poles of the closed loop grow, by Nyquist's count beside the imaginary axis."""
        closed = self.poles()
        beside = 1e-4 * np.abs(closed)[np.abs(closed) > 1e-9 * np.abs(closed).max()].min()
        s = beside + 1j * self.grid()
        whole = np.concatenate([np.conj(s[::-1]), [s[0].real], s])
        turned = np.unwrap(np.angle(1 + self.open(whole)))
        growing = (self.poles(0.0).real > s[0].real).sum()
        return round(growing - (turned[-1] - turned[0]) / (2 * np.pi))


def pendulum(dice, rate):
    """Return the deck, inertia, and modes of a pendulum that hangs or stands."""
    inertia, arm = 10 ** dice.uniform(-2, 1), float(dice.choice([-1.0, 1.0])) * 10 ** dice.uniform(-2, 0)
    total = inertia + arm**2
    g = rate**2 * total / abs(arm) * 10 ** dice.uniform(-1, 1)
    deck = f"&scene gravity=0,{-g!r} /\n&body name='rod' kind='rigid' mass=1 inertia={inertia!r} com=0,{arm!r} /\n"
    deck += "&joint name='hub' type='revolute' body_a='rod' body_b='ground' /\n&sensor name='y' quantity='angle' body='rod' /\n"
    deck += "&force name='m' type='torque' body='rod' moment=1 controller='c' /\n"
    return deck, total, (np.array([total]), np.zeros(1), np.array([-arm * g]), np.ones(1), np.ones(1))


def cart(dice, rate):
    """Return the same of a cart, free or on a spring."""
    total = 10 ** dice.uniform(-2, 2)
    k, c = total * rate**2 * 10 ** dice.uniform(-2, 1), total * rate * 10 ** dice.uniform(-5, 0)
    deck = f"&body name='cart' kind='rigid' mass={total!r} inertia=0.1 /\n&sensor name='y' quantity='position' body='cart' /\n"
    deck += "&joint name='way' type='prismatic' body_a='cart' body_b='ground' /\n"
    deck += "&force name='m' body='cart' fx=1 controller='c' /\n"
    if dice.random() < 0.5:
        deck += "&spring name='k' type='linear' body_a='cart' body_b='ground' point_b=-1,0 free_length=1 "
        deck += f"stiffness={k!r} damping={c!r} /\n"
    else:
        k = c = 0.0
    return deck, total, (np.array([total]), np.array([c]), np.array([k]), np.ones(1), np.ones(1))


def arm(dice, rate):
    """Return the same of a flexible arm with a rotor, driven at its hub, seen there or at its tip."""
    elements, width, rotor = int(dice.integers(2, 5)), 0.01, 10 ** dice.uniform(-3, 0)
    flexural, beta = (rate * 10 ** dice.uniform(0, 2)) ** 2, 10 ** dice.uniform(-6, -2) / rate
    seen = -1 if dice.random() < 0.3 else 1
    deck = f"&material name='a' density={1 / width**2!r} young={flexural * 12 / width**4!r} rayleigh_stiffness={beta!r} /\n"
    deck += f"&section name='a' shape='rectangle' width={width} height={width} /\n"
    deck += f"&body name='arm' kind='beam' length=1.0 elements={elements} material='a' section='a' reference='clamped' "
    deck += "axial=.false. /\n&joint name='hub' type='revolute' body_a='arm' node_a=1 body_b='ground' /\n"
    deck += f"&lump body='arm' node=1 inertia={rotor!r} /\n&sensor name='y' quantity='angle' body='arm' node={seen} /\n"
    deck += "&force name='m' type='torque' body='arm' node=1 moment=1 controller='c' /\n"
    whole_k, whole_m = bending(elements, 1.0, flexural, 1.0)
    whole_m[1, 1] += rotor
    stiffness, modes = scipy.linalg.eigh(whole_k[1:, 1:], whole_m[1:, 1:])
    stiffness[0] = 0.0  # the free turn
    sees = modes[-1 if seen == -1 else 0]
    return deck, rotor + 1 / 3, (np.ones(len(stiffness)), beta * stiffness, stiffness, modes[0], sees)


def stiff_parts(dice):
    """Return parts that nothing joins to the loop, of up to 1e7 rad/s."""
    deck, stiffness = "", 10 ** dice.uniform(4, 10)
    for k in range(int(dice.integers(0, 3))):
        deck += f"&body name='s{k}' kind='rigid' mass=1 inertia=1 position=0,{5 + k} /\n"
        deck += f"&joint name='s{k}' type='prismatic' body_a='s{k}' body_b='ground' point_b=0,{5 + k} /\n"
        deck += f"&spring name='s{k}' type='linear' body_a='s{k}' body_b='ground' point_b=-1,{5 + k} free_length=1 "
        deck += f"stiffness={stiffness!r} /\n"
    if dice.random() < 0.4:
        deck += "&material name='s' density=7800 young=2.1e11 /\n&section name='s' shape='rectangle' width=0.01 height=0.01 /\n"
        deck += f"&body name='beam' kind='beam' length=0.1 elements={dice.integers(1, 9)} material='s' section='s' "
        deck += "reference='clamped' position=0,9 /\n&joint name='beam' type='weld' body_a='beam' node_a=1 body_b='ground' "
        deck += "point_b=0,9 /\n"
    return deck


def random_loop(seed):
    """Return a random loop: a pendulum, a cart or a flexible arm, beside stiff parts that it does not touch."""
    dice = np.random.default_rng(seed)
    rate = 10 ** dice.uniform(-3, 2)  # of the loop [rad/s]
    deck, total, modes = (pendulum, cart, arm)[seed % 3](dice, rate)
    kp = total * rate**2 * 10 ** dice.uniform(-1, 1) * dice.choice([1.0, 1.0, 1.0, -1.0])
    law = {"kp": kp, "kd": total * rate * 10 ** dice.uniform(-1, 1)}
    law |= {"ki": abs(kp) * rate * 10 ** dice.uniform(-3, 0)} if dice.random() < 0.4 else {}
    law |= {"filter": 10 ** dice.uniform(-3, 0) / rate} if dice.random() < 0.4 else {}
    law |= {"delay": 10 ** dice.uniform(-3, 0) / rate} if dice.random() < 0.4 else {}
    law = {name: float(value) for name, value in law.items()}
    deck += f"&history name='r' coefficients=0 /\n&controller name='c' history='r' argument='{'y.x' if seed % 3 == 1 else 'y'}' "
    deck += " ".join(f"{k}={v!r}" for k, v in law.items()) + " /\n"
    return Loop(deck + stiff_parts(dice), *modes, law)
