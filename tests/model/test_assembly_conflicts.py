"""What cannot be assembled names the joint that is one too many, the loop that does not reach; that welds hold angles is said."""

from __future__ import annotations

import re

import numpy as np
import pytest

RUN = "&transient t_end=0.1 step=0.01 /\n"


def bar(name: str, length: float, start=(0.0, 0.0), angle: float = 0.0) -> str:
    """Return a rigid bar."""
    return (
        f"&body name='{name}' kind='rigid' mass=1.0 inertia={length**2 / 12!r} com={length / 2!r},0.0 "
        f"position={float(start[0])!r},{float(start[1])!r} angle={float(angle)!r} /\n"
    )


def four_bar(rng, stretch: float = 1.0):
    """Return the bodies of a four-bar that closes if its rocker is not stretched, and its joints in the deck's order."""
    a, b, c = rng.uniform(0.5, 3.0), rng.uniform(-0.4, 0.4), rng.uniform(1.0, 2.0)
    one = np.array([np.cos(a), np.sin(a)]) * 0.4
    two = one + np.array([np.cos(b), np.sin(b)])
    foot = two - np.array([np.cos(c), np.sin(c)]) * 0.8
    foot = foot.tolist()
    bodies = bar("crank", 0.4, (0, 0), a) + bar("rod", 1.0, one, b) + bar("rocker", 0.8 * stretch, foot, c)
    joints = [
        "&joint name='a' type='{}' body_a='crank' /\n",
        "&joint name='b' type='{}' body_a='rod' body_b='crank' point_b=0.4,0.0 /\n",
        f"&joint name='c' type='{{}}' body_a='rocker' point_b={foot[0]!r},{foot[1]!r} /\n",
        f"&joint name='d' type='{{}}' body_a='rod' point_a=1.0,0.0 body_b='rocker' point_b={0.8 * stretch!r},0.0 /\n",
    ]
    return bodies, joints


def told(run_deck, deck: str) -> str:
    """Return what is said of a deck that cannot be assembled, without the path."""
    place, _, words = run_deck(deck + RUN, expect=2).stderr.partition(": the mechanism cannot be assembled: ")
    assert f" in line {place.partition('.nml:')[2]} " in words  # that of the joint or drive which it names
    return words


@pytest.mark.parametrize("seed", range(8))
def test_the_joint_that_is_one_too_many(run_deck, seed):
    """A four-bar, and a fifth joint that pins a point of its rod beside where it is: wherever it stands, it is the last."""
    rng = np.random.default_rng(seed)
    bodies, joints = four_bar(rng)
    extra = f"&joint name='extra' type='revolute' body_a='rod' point_a=0.5,0.2 point_b={rng.uniform(2, 3)!r},-1.0 /\n"
    words = told(run_deck, bodies + "".join(joints).format(*4 * ["revolute"]) + extra)
    assert words.startswith('revolute joint "extra" in line 8 stays open by ')
    assert "they leave no motion that could close it, it is one too many" in words
    assert not any(f'"{name}"' in words for name in "abcd")


@pytest.mark.parametrize("seed", range(8))
def test_a_loop_whose_lengths_do_not_reach(run_deck, seed):
    rng = np.random.default_rng(seed)
    bodies, joints = four_bar(rng, stretch=10.0)
    order = rng.permutation(4)
    words = told(run_deck, bodies + "".join(joints[k] for k in order).format(*4 * ["revolute"]))
    assert words.startswith(f'revolute joint "{"abcd"[order[-1]]}" in line 7 stays open by ')
    assert "the lengths of its loop do not reach" in words


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", ["weld", "prismatic"])
def test_an_angle_that_contradicts(run_deck, seed, kind):
    """An L of two bars between two pins: held at an angle at which the pins are not that far apart."""
    rng = np.random.default_rng(seed)
    right, wrong = rng.uniform(0.5, 1.0), rng.uniform(1.3, 1.9)
    if kind == "weld":
        end = (np.array([1.0, 0.0]) + 0.7 * np.array([np.cos(right), np.sin(right)])).tolist()
        words = told(
            run_deck,
            bar("p", 1.0)
            + bar("q", 0.7, (1.0, 0.0), wrong)
            + "&joint name='a' type='weld' body_a='p' /\n"
            + "&joint name='w' type='weld' body_a='q' body_b='p' point_b=1.0,0.0 /\n"
            + f"&joint name='b' type='revolute' body_a='q' point_a=0.7,0.0 point_b={end[0]!r},{end[1]!r} /\n",
        )
        assert words.startswith('revolute joint "b" in line 5 stays open by ')
    else:
        words = told(
            run_deck,
            bar("p", 1.0, (0.3, 0.0), wrong)
            + "&joint name='w' type='prismatic' body_a='p' /\n"
            + f"&joint name='b' type='distance' body_a='p' point_a=1.0,0.0 point_b=0.0,{float(np.sin(right))!r} length=1.0e-3 /\n"
            + f"&joint name='c' type='distance' body_a='p' point_b={-float(np.cos(right))!r},0.0 length=1.0e-3 /\n",
        )
        assert words.startswith('distance joint "b" in line 3 stays open by ')
    assert "(welds and prismatic joints hold the angles that the deck has)" in words


def test_a_drive_that_cannot_be_followed(run_deck):
    """A rocker driven further than its four-bar lets it go; the drive stands in an included file."""
    bodies, joints = four_bar(np.random.default_rng(3))
    deck = bodies + "".join(joints).format(*4 * ["revolute"])
    deck += "&history name='h' kind='polynomial' coefficients=-1.0 /\n"
    deck += "&drive name='m' type='rotation' body_a='rocker' history='h' /\n"
    words = told(run_deck, deck)
    assert words.startswith('drive "m" in line 9 starts at -1 rad, but its bodies stand at ')
    assert "rad where those before it in the deck are closed: the lengths of its loop do not reach further" in words


def test_many_links(run_deck):
    """A chain of 60 links whose end is pinned out of reach, a joint in its middle doubled beside its place before that."""
    n = 60
    deck = "".join(bar(f"b{k}", 0.1, (0.1 * k, 0.0)) for k in range(n)) + "&joint name='j0' type='revolute' body_a='b0' /\n"
    for k in range(1, n):
        deck += f"&joint name='j{k}' type='revolute' body_a='b{k}' body_b='b{k - 1}' point_b=0.1,0.0 /\n"
        if k == 30:
            deck += "&joint name='wrong' type='revolute' body_a='b30' body_b='b29' point_a=0.05,0.02 point_b=0.1,0.0 /\n"
    words = told(run_deck, deck + f"&joint name='end' type='revolute' body_a='b{n - 1}' point_a=0.1,0.0 point_b=9.0,0.0 /\n")
    assert words.startswith(f'revolute joint "wrong" in line {n + 32} stays open by ')
    assert "one too many" in words


ARM = "&body name='{0}' kind='beam' length=0.5 elements=2 material='m' section='s' {1} /\n"
TWO_MOTORS = (
    "&material name='m' density=2700 young=7e10 /\n&section name='s' shape='circle' diameter=0.01 /\n"
    + ARM.format("a", "angle=1.0 reference='clamped'")
    + ARM.format("b", "position=0.8,0.0 angle=2.0 reference='clamped'")
    + bar("rod", 0.6, (0.3, 0.4))
    + """&joint name='ja' type='revolute' body_a='a' node_a=1 /
&joint name='jb' type='revolute' body_a='b' node_a=1 point_b=0.8,0.0 /
&joint name='jr' type='revolute' body_a='rod' body_b='a' node_b=-1 /
&joint name='js' type='revolute' body_a='rod' point_a=0.6,0.0 body_b='b' node_b=-1 /
&history name='ha' kind='polynomial' coefficients=1.0 /
&history name='hb' kind='polynomial' coefficients={} /
&drive name='da' type='rotation' body_a='a' node_a=1 history='ha' /
&drive name='db' type='rotation' body_a='b' node_a=1 history='hb' /
&sensor name='fa' quantity='reaction' drive='da' /
&sensor name='fb' quantity='reaction' drive='db' /
"""
)


def test_a_drive_beside_the_loop_of_flexible_arms_is_told_where_it_stands(run_deck):
    """A loop of one freedom with two motors: the second is told the angle to all digits; at 1e-6 rad from there the arms bend."""
    words = told(run_deck, TWO_MOTORS.format(1.9))
    found = re.match(r'drive "db" in line 13 starts at 1\.9 rad, but its bodies stand at (\S+) rad where those before it', words)
    assert "these leave no motion that could follow it; expected a history that starts there, bodies near" in words
    end = np.array([0.5 * np.cos(1.0), 0.5 * np.sin(1.0)])
    reach = 0.8 - end[0], -end[1]
    stands = float(found[1])
    closed = np.hypot(reach[0] + 0.5 * np.cos(stands), reach[1] + 0.5 * np.sin(stands))
    assert closed == pytest.approx(0.6, abs=1e-13)
    run_deck(TWO_MOTORS.format(repr(stands)) + RUN.replace("0.01", "1e-5").replace("0.1", "1e-5"))
    static = "&static /\n&transient t_end=1e-5 step=1e-6 /\n"
    moments = [run_deck(TWO_MOTORS.format(repr(stands + off)) + static).history["fb.m"][0] for off in (1e-6, 2e-6)]
    still = run_deck(TWO_MOTORS.format(repr(stands + 1e-6)) + static.replace("&static /\n", ""))
    assert "flexible bodies are bent at the start" in still.stderr
    assert moments[1] == pytest.approx(2 * moments[0], rel=1e-3)  # a spring: what the arms resist
    assert np.abs(still.history["fb.m"] - moments[0]).max() < 1e-5 * abs(moments[0])  # bent as at rest


def test_a_drive_that_turns_its_body_says_both_values(run_deck):
    deck = bar("b", 1.0, angle=1.2) + "&joint name='j' type='revolute' body_a='b' /\n&history name='h' kind='polynomial' "
    deck += "coefficients=0.0,1.0 /\n&drive name='d' type='rotation' body_a='b' history='h' /\n"
    told = run_deck(deck + RUN).stderr
    assert 'drive "d" starts at 0 rad, the deck has its bodies at 1.2 rad: they were moved; expected' in told
    assert "moved" not in run_deck(deck.replace(" history='h'", " history='h' relative=.true.") + RUN).stderr


def test_a_slider_out_of_reach_tells_how_far_it_is_open_where_the_others_are_closed(run_deck):
    """Found where it was said to stay open by 0 m: with the others closed the end is 0.3 sin 0.8 + sin(-0.6) above the axis."""
    deck = """&body name='a' mass=1 inertia=1 position=-0.2,-1.3 angle=0.8 /
&body name='b' mass=1 inertia=1 position=-0.8,-0.4 angle=-0.6 /
&joint name='p' type='prismatic' body_a='a' /
&joint name='q' type='revolute' body_a='b' body_b='a' point_b=0.3,0.0 /
&joint name='z' type='slider' body_a='b' point_a=1,0 point_b=-1.3,-1.6 /
"""
    open_by = float(re.search(r'"z" in line 5 stays open by (\S+) m', told(run_deck, deck))[1])
    assert open_by == pytest.approx(0.3 * np.sin(0.8) + np.sin(-0.6) + 1.6, rel=1e-5)


def test_a_singular_start_is_called_so(run_deck):
    """Two bars along the line of their pivots: both ways to close are equally near; turned a little, one is."""
    deck = """&body name='a' mass=1 inertia=0.02 com=0.2,0 angle={} /
&body name='b' mass=1 inertia=0.02 com=0.2,0 position=0.6,0 /
&joint name='p' type='revolute' body_a='a' /
&joint name='q' type='revolute' body_a='b' body_b='a' point_b=0.6,0 /
&joint name='r' type='revolute' body_a='b' point_a=0.5,0 point_b=0.3,0 /
"""
    words = told(run_deck, deck.format(0))
    assert "this start, which is singular: bodies that are turned by 0.001 rad close it" in words
    assert "one too many" not in words
    run_deck(deck.format(0.001) + RUN)
    rigid = deck.format(0).replace("type='revolute' body_a='b' body_b", "type='weld' body_a='b' body_b")
    assert "it is one too many" in told(run_deck, rigid)


@pytest.mark.parametrize("away", [30.0, 1e5])
def test_bodies_that_are_far_apart_come_together(run_deck, away):
    """A slider-crank whose rod and slider the deck has elsewhere: they come near, and the loop closes as its lengths say."""
    deck = f"""&body name='c' mass=0.5 inertia=2e-3 angle=0.7 /
&body name='r' mass=0.4 inertia=4e-3 com=0.1,0 position={away},0.3 angle=-0.2 /
&body name='p' mass=0.5 inertia=1e-3 position={away + 0.3},0 /
&joint name='o' type='revolute' body_a='c' /
&joint name='q' type='revolute' body_a='r' body_b='c' point_b=0.1,0 /
&joint name='w' type='revolute' body_a='r' point_a=0.3,0 body_b='p' /
&joint name='g' type='prismatic' body_a='p' /
&sensor name='c' quantity='angle' body='c' /
&sensor name='p' quantity='position' body='p' /
"""
    found = run_deck(deck + RUN).history
    angle, place = found["c"][0], found["p.x"][0]
    assert abs(angle - 0.7) < 0.3
    assert np.hypot(place - 0.1 * np.cos(angle), 0.1 * np.sin(angle)) == pytest.approx(0.3, abs=1e-9)
