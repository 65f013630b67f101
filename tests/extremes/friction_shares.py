"""Whether friction holds mechanisms at rest: what the solver finds against a search of all shares of the load by a grid.

Usage: friction_shares.py [first [last]], sets from first to last (1 to 500); prints each set that differs, and the counts.
Of up to three joints with friction each set takes a limit, the others none. With the forces in them as unknowns beside the
reactions, equilibrium leaves as many free as there are joints with friction beyond the freedoms that they hold; the free ones are
searched, the reactions follow, and the mechanism can be held where every share is below its limit for some of them.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))

import numpy as np
from extreme_cases import call
from scipy.linalg import null_space
from scipy.optimize import minimize

G = 9.81
EDGE = 1e-6  # a load so near to what can be held is neither held nor not


class Mechanism:
    """Random links with pins, one of them perhaps on a rail, at rest under weight and a torque."""

    def __init__(self, number: int) -> None:
        """Draw a four-bar, a slider-crank or two links in a row."""
        self.random = random = np.random.default_rng(number)
        kind = random.integers(3)
        a, b = np.zeros(2), random.uniform(0.2, 0.5) * unit(random.uniform(-3, 3))
        c = b + random.uniform(0.3, 0.8) * unit(random.uniform(-3, 3))
        self.bodies = [(a, b), (b, c)]
        self.joints = [("revolute", 0, -1, a), ("revolute", 1, 0, b)]
        if kind == 0:
            d = c + random.uniform(0.3, 0.8) * unit(random.uniform(-3, 3))
            self.bodies.append((c, d))
            self.joints += [("revolute", 2, 1, c), ("revolute", 2, -1, d)]
        elif kind == 1:
            self.bodies.append((c, c))
            self.joints += [("revolute", 2, 1, c), ("prismatic", 2, -1, c)]
        self.slope = random.uniform(-1, 1)
        self.masses = random.uniform(0.2, 2.0, len(self.bodies))
        self.centres = [(p + q) / 2 for p, q in self.bodies]
        count = random.integers(1, min(4, len(self.joints) + 1))
        self.rough = sorted(random.choice(len(self.joints), count, replace=False))
        self.friction = random.uniform(0.05, 1.0, count)
        self.radius = random.uniform(0.005, 0.05, count)
        self.preload = np.where(random.random(count) < 0.3, random.uniform(0, 0.3, count), 0.0)
        self.equations()
        self.torque = self.load()

    def equations(self) -> None:
        """Sum the wrenches of unit reactions, of unit friction and of weight on the bodies."""
        columns, self.rows = [], []
        along, across = unit(self.slope), unit(self.slope + np.pi / 2)
        for kind, *between, place in self.joints:
            pin = kind == "revolute"
            forces = [([1, 0], 0), ([0, 1], 0)] if pin else [(across, 0), ([0, 0], 1)]
            self.rows.append(range(len(columns), len(columns) + 2))
            columns += [self.wrench(between, place, *x) for x in forces]
        self.reactions = np.array(columns).T
        tangents = [([0, 0], 1) if self.joints[k][0] == "revolute" else (along, 0) for k in self.rough]
        self.tangents = np.array([self.wrench(self.joints[k][1:3], self.joints[k][3], *x) for k, x in zip(self.rough, tangents)]).T
        self.weight = np.array([x for m in self.masses for x in (0, -m * G, 0)])
        self.turn = np.eye(3 * len(self.bodies))[2]

    def wrench(self, between: list[int], place: np.ndarray, force: list[float], moment: float) -> np.ndarray:
        """Return what a force and a moment between two bodies (-1: the ground) do to all coordinates."""
        q = np.zeros(3 * len(self.bodies))
        for body, sign in zip(between, (1, -1)):
            if body >= 0:
                arm = place - self.centres[body]
                q[3 * body : 3 * body + 3] += sign * np.array([*force, moment + arm[0] * force[1] - arm[1] * force[0]])
        return q

    def load(self) -> float:
        """Return a torque on the first body from nothing to twice of what friction holds, about, beside what balances weight."""
        matrix = np.column_stack([self.reactions, self.turn])
        balance = np.linalg.lstsq(matrix, -self.weight, rcond=None)[0]
        limits = self.limits(balance[:-1])
        more = 0.0
        for direction in self.tangents.T * limits[:, None]:
            more += abs(np.linalg.lstsq(matrix, -direction, rcond=None)[0][-1])
        return float(balance[-1] + self.random.uniform(-2, 2) * more)

    def limits(self, reactions: np.ndarray) -> np.ndarray:
        """Return up to which force or moment each joint sticks."""
        found = []
        for k, mu, r, p in zip(self.rough, self.friction, self.radius, self.preload):
            own = reactions[self.rows[k]]
            found.append(p + (mu * r * np.hypot(*own) if self.joints[k][0] == "revolute" else mu * abs(own[0])))
        return np.array(found)

    def excess(self) -> float:
        """Return the least by which any shares exceed a limit, of the largest limit or force there; negative: it can be held."""
        matrix = np.column_stack([self.reactions, self.tangents])
        load = self.weight + self.turn * self.torque
        start = np.linalg.lstsq(matrix, -load, rcond=None)[0]
        if np.abs(matrix @ start + load).max() > 1e-9 * np.abs(load).max():
            return 1.0  # more freedoms than friction
        free = null_space(matrix)
        count = self.reactions.shape[1]

        def beyond(z: np.ndarray) -> float:
            x = start + free @ np.tan(np.atleast_1d(z)) * 10.0
            limits, shares = self.limits(x[:count]), np.abs(x[count:])
            return float(np.max((shares - limits) / np.maximum(limits, shares).clip(1e-12)))

        if free.shape[1] == 0:
            return beyond(np.zeros(0))
        axis = np.arctan(np.sinh(np.linspace(-9, 9, 161 if free.shape[1] == 1 else 61)) / 50.0)
        points = np.stack(np.meshgrid(*[axis] * free.shape[1]), -1).reshape(-1, free.shape[1])
        values = np.array([beyond(z) for z in points])
        best = values.min()
        for k in np.argsort(values)[:6]:
            if best < -EDGE:
                break
            found = minimize(beyond, points[k], method="Nelder-Mead", options={"xatol": 1e-12, "fatol": 1e-12, "maxiter": 2000})
            best = min(best, found.fun)
        return float(best)

    def deck(self) -> str:
        """Return the deck of a run that shows which joints slip at its start."""
        text = [f"&scene gravity=0.0,{-G} /"]
        for k, (mass, centre) in enumerate(zip(self.masses, self.centres)):
            text.append(f"&body name='b{k}' mass={mass!r} inertia={mass / 50!r} position={centre[0]!r},{centre[1]!r} /")
        text.append(f"&force name='t' type='torque' body='b0' moment={self.torque!r} /")
        for k, (kind, a, b, place) in enumerate(self.joints):
            other = f"body_b='b{b}' " if b >= 0 else ""
            at = place - (self.centres[b] if b >= 0 else 0.0)
            own = place - self.centres[a]
            keys = f"direction={self.slope!r} " if kind == "prismatic" else ""
            if k in self.rough:
                i = self.rough.index(k)
                keys += f"friction={self.friction[i]!r} preload={self.preload[i]!r} "
                keys += f"pin_radius={self.radius[i]!r} " if kind == "revolute" else ""
                text.append(f"&sensor name='f{i}' quantity='friction' joint='j{k}' /")
            points = f"point_a={own[0]!r},{own[1]!r} point_b={at[0]!r},{at[1]!r}"
            text.append(f"&joint name='j{k}' type='{kind}' body_a='b{a}' {other}{points} {keys}/")
        text.append("&transient method='dopri5' tolerance=1e-6 t_end=1e-6 output_step=1e-6 /")
        return "\n".join(text).replace("np.float64(", "").replace(")", "") + "\n"


def unit(angle: float) -> np.ndarray:
    """Return the direction of an angle."""
    return np.array([np.cos(angle), np.sin(angle)])


def judge(number: int) -> tuple[int, str, float]:
    """Return what the solver finds of a set: held, moves, or what it says instead; and by how much limits are exceeded."""
    mechanism = Mechanism(number)
    ran = call(mechanism.deck())
    if ran.status or ran.history is None:
        return number, ran.told.strip().split("\n")[-1], mechanism.excess()
    states = [ran.history[f"f{i}.state"][0] for i in range(len(mechanism.rough))]
    moving = any(states) or mechanism.excess() == 1.0
    return number, "moves" if moving else "held", mechanism.excess()


def main() -> int:
    """Judge the sets; the exit status says whether all agree."""
    first, last = (int(x) for x in (sys.argv[1:] + ["1", "500"][len(sys.argv) - 1 :]))
    with ThreadPoolExecutor() as pool:
        rows = list(pool.map(judge, range(first, last + 1)))
    agree = wrong = held = 0
    for number, found, excess in rows:
        same = abs(excess) < EDGE or found == ("held" if excess < 0 else "moves")
        agree += same
        held += excess < 0
        wrong += found == "held" and not same
        if not same:
            print(f"set {number}: {found}, limits exceeded by {excess:.3e} of the force at least")
    print(f"{len(rows)} sets, {held} can be held, {agree} agree, {wrong} held wrongly")
    return int(agree < len(rows))


if __name__ == "__main__":
    sys.exit(main())
