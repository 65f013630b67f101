"""Nothing is passed over in long steps of smooth motion: discs, rotors, cams, tracks, by all methods and tolerances."""

import numpy as np
import pytest

METHODS = (
    "method='dopri5' tolerance=1e-2",
    "method='dopri5' tolerance=1e-8",
    "method='radau' tolerance=1e-2",
    "method='radau' tolerance=1e-8",
    "method='dopri5' step=0.5",
    "method='rk4' step=0.5",
    "method='radau' step=0.5",
    "accuracy=1e-4",
)


def events_of(run):
    """Return the words of each line of events.txt."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    return [line.split() for line in lines if not line.startswith("#")]


def last_row(run):
    """Return the last value of each column by its name."""
    return {name: run.history[name][-1] for name in run.history.names}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("start", [-2.137, -1.3])
def test_discs_that_fly_freely_meet(method, start, run_deck):
    """Equal discs, head on and elastic: they exchange their velocities. A hundredth of a millimetre beside they pass."""
    deck = f"""&profile name='p' kind='circle' radius=0.03 /
&body name='a' mass=1 inertia=1e-3 position={start},0 velocity=1,0 /
&body name='b' mass=1 inertia=1e-3 position=0,0 /
&body name='c' mass=1 inertia=1e-3 position={start},1.06001 velocity=1,0 /
&body name='d' mass=1 inertia=1e-3 position=0,1 /
&stop name='s' type='profile' body_a='a' radius=0.03 body_b='b' profile='p' restitution=1 /
&stop name='t' type='profile' body_a='c' radius=0.03 body_b='d' profile='p' restitution=1 /
&sensor name='va' quantity='velocity' body='a' /
&sensor name='vb' quantity='velocity' body='b' /
&transient t_end=4 {method} output_step=4 /
"""
    run = run_deck(deck)
    assert [(words[1], round(float(words[0]), 9)) for words in events_of(run)] == [("s", round(-start - 0.06, 9))]
    end = last_row(run)
    assert abs(end["va.x"]) < 1e-9
    assert abs(end["vb.x"] - 1) < 1e-9


SPUN = """&body name='b' mass=1 inertia=0.01 angular_velocity=100 /
&joint name='A' type='revolute' body_a='b' /
&sensor name='p' quantity='position' body='b' point=0.1,0 /
&sensor name='v' quantity='velocity' body='b' point=0.1,0 /
&sensor name='a' quantity='angle' body='b' /
&sensor name='w' quantity='angular_velocity' body='b' /
"""


def brake_by_hand(level, until):
    """Return the rate at a time of SPUN with -1 N m where sin(angle) is above a level: what a sector takes, sector by sector."""
    sector, t, rate = [np.arcsin(level), np.pi - np.arcsin(level)], 0.0, 100.0
    for turn in range(100):
        for moment, angle in ((0.0, (sector[0] if turn == 0 else 2 * np.pi + sector[0] - sector[1])), (-100.0, np.ptp(sector))):
            after = np.sqrt(rate**2 + 2 * moment * angle)
            duration = 2 * angle / (rate + after)
            if t + duration > until:
                return rate + moment * (until - t)
            t, rate = t + duration, after
    raise AssertionError


@pytest.mark.parametrize("method", [*METHODS[:4], "accuracy=1e-4"])
@pytest.mark.parametrize("word", ["switch", "table"])
def test_a_brake_acts_in_its_sector_of_each_turn(method, word, run_deck):
    """A rotor for which only the brake limits steps: by a switch over a position, and by a table over it with corners."""
    deck = SPUN + "&history name='on' coefficients=-1 /\n&history name='off' coefficients=0 /\n"
    if word == "switch":
        deck += "&history name='s' kind='switch' argument='p.y' level=0.08 histories='on','off' /\n"
        deck += "&force name='f' type='torque' body='b' moment=1 history='s' /\n"
        exact = brake_by_hand(0.8, 1.0)
    else:  # the work of a moment that rises from 0 at 0.08 to 1 at 0.1 is the same in each turn
        deck += "&history name='s' kind='table' interpolation='linear' time=-1,0.08,0.1,1 value=0,0,-1,-1 /\n"
        deck += "&force name='f' type='torque' body='b' moment=1 history='s' argument='p.y' /\n"
        work = (2 * np.sqrt(1 - 0.8**2) - 0.8 * (np.pi - 2 * np.arcsin(0.8))) / 0.2
    end = last_row(run_deck(deck + f"&transient t_end=1 {method} output_step=1 /\n"))
    tolerance = 1e-3 if "-2" in method else 1e-4 if "accuracy" in method else 1e-6
    if word == "table":  # after whole turns
        turns = np.floor((end["a"] - np.pi / 2) / (2 * np.pi))
        assert turns > 13
        assert np.cos(end["a"] - np.pi / 2) < 0.8  # beside the sector
        exact = np.sqrt(100.0**2 - 2 * work / 0.01 * (turns + 1))
    assert abs(end["w"] - exact) < tolerance * 100


@pytest.mark.parametrize("method", METHODS[:4])
def test_a_rotor_stays_between_the_sides_of_its_stop(method, run_deck):
    deck = SPUN + "&stop name='s' type='position' body_a='b' point_a=0.1,0 direction={pi/2} upper=0.099 restitution=1 /\n"
    run = run_deck(deck + f"&transient t_end=1 {method} output_step=1e-2 /\n")
    sector = np.pi + 2 * np.arcsin(0.99)
    assert len(events_of(run)) == 1 + np.floor((100.0 - np.arcsin(0.99)) / sector)
    assert run.history["a"].max() < np.arcsin(0.99) + 1e-9
    assert run.history["a"].min() > -np.pi - np.arcsin(0.99) - 1e-9


@pytest.mark.parametrize("method", METHODS[:4])
def test_a_switch_of_a_velocity_that_rises_and_falls_within_a_step(method, run_deck):
    """A root that starts at zero and is zero again within the next long step falls there, not at once."""
    deck = SPUN + "&history name='on' coefficients=1e-9 /\n&history name='off' coefficients=0 /\n"
    deck += "&history name='s' kind='switch' argument='v.x' level=5 histories='on','off' /\n"  # -10 sin(100 t)
    deck += "&force name='f' type='torque' body='b' moment=1 history='s' /\n"
    run = run_deck(deck + f"&transient t_end=0.5 {method} output_step=0.5 /\n")
    times = np.array([float(words[0]) for words in events_of(run)])
    exact = np.array([angle + 2 * np.pi * k for k in range(9) for angle in (7 * np.pi / 6, 11 * np.pi / 6)]) / 100
    np.testing.assert_allclose(times, exact[exact < 0.5], rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS[:4])
@pytest.mark.parametrize("flat", [False, True])
def test_a_narrow_lobe_meets_its_follower(method, flat, run_deck):
    """A cam that turns freely, with a lobe in a fraction of its turn, strikes a follower that hovers at half of its lift."""
    width = 1.1 if flat else 0.15
    deck = "&history name='rise' kind='cycloid' start_value=0 end_value=1e-4 start=0 finish=W /\n"
    deck += "&history name='fall' kind='cycloid' start_value=1e-4 end_value=0 start=0 finish=W /\n"
    deck += "&history name='rest' coefficients=0 /\n"
    deck += "&history name='law' kind='sequence' histories='rise','fall','rest' durations=W,W,{2*pi-2*W} periodic=.true. /\n"
    follower, height = ("follower='flat'", "face={pi/2}"), 0.03005
    if not flat:
        follower, height = ("radius=0.01", "radius=0.01"), 0.04005
    deck += f"&profile name='cam' kind='law' {follower[0]} history='law' base_radius=0.03 /\n"
    deck += "&body name='shaft' mass=1 inertia=1e3 angle=-1 angular_velocity=50 /\n"
    deck += "&joint name='b' type='revolute' body_a='shaft' /\n"
    deck += f"&body name='f' mass=1e-3 inertia=1e-4 position=0,{height} /\n"
    deck += "&joint name='g' type='prismatic' body_a='f' direction={pi/2} /\n"
    deck += f"&stop name='c' type='profile' body_a='f' {follower[1]} body_b='shaft' profile='cam' restitution=0.5 /\n"
    deck += "&sensor name='y' quantity='position' body='f' /\n"
    run = run_deck(deck.replace("W", str(width)) + f"&transient t_end=0.1 {method} output_step=0.1 /\n")
    assert len(events_of(run)) == 1
    assert abs(float(events_of(run)[0][0]) - (1 + width / 2) / 50) < 1e-9
