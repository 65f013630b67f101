"""The advised steps against what runs really do.

Nothing diverges at 0.98 of the safe bound, and the smallest current bound along a run is within 5 % of the largest step
that stays stable, found by bisection over 1000 periods of the limiting mode.
"""

import json
import math
import re

import numpy as np
import pytest

CRANK = """&scene title='slider-crank' /
&material name='m' density=1600.0 young=2.1e10 {ghm} /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.3492 elements={elements} material='m' section='s' position=0.1524,0.0 {axial} /
&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length=0.1524 /
&joint name='slider' type='slider' body_a='rod' node_a=-1 /
&force name='torque' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=0.3 /
&sensor name='rod' quantity='angle' body='rod' /
"""
FOUR_BAR = """&scene title='four-bar' gravity=0.0,-9.81 /
&material name='steel' density=7850.0 young=2.1e11 /
&material name='polymer' density=1200.0 young=3.0e9 ghm_alpha=0.4,0.6 ghm_zeta=1.5,2.5 ghm_omega=400.0,4000.0 /
&section name='strip' shape='rectangle' width=0.02 height=0.006 /
&section name='bar' shape='rectangle' width=0.02 height=0.004 /
&body name='crank' kind='rigid' mass=0.3 inertia=4.0e-4 com=0.05,0.0 angle=1.57 /
&body name='coupler' kind='beam' length=0.35 elements=3 material='polymer' section='strip' position=0.0,0.1 angle=0.49 /
&body name='rocker' kind='beam' length=0.28 elements=2 material='steel' section='bar' position=0.4,0.0 angle=1.9 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='revolute' body_a='coupler' node_a=-1 body_b='rocker' node_b=-1 /
&joint name='d' type='revolute' body_a='rocker' node_a=1 point_b=0.4,0.0 /
&sensor name='rod' quantity='angle' body='rocker' /
"""
ARM = """&scene title='spinning arm' /
&material name='m' density=2700.0 young=7.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='arm' kind='beam' length=1.0 elements=4 material='m' section='s' reference='clamped' angular_velocity=20.0 /
&joint name='hub' type='revolute' body_a='arm' node_a=1 /
&history name='w' kind='polynomial' coefficients=20.0 /
&drive name='motor' type='rotation' body_a='arm' history='w' rate=.true. /
&sensor name='rod' quantity='deflection' body='arm' node=-1 /
"""
FRAME = """&scene title='frame of two materials with a lump' gravity=0.0,-1.0 /
&material name='steel' density=7850.0 young=2.1e11 /
&material name='polymer' density=1200.0 young=3.0e9 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='f' kind='frame' node_x=0.0,0.2,0.35,0.4 node_y=0.0,0.0,0.1,0.3 element_nodes=1,2,2,3,3,4 section='s'
  element_material='polymer','steel','polymer' /
&lump body='f' node=2 mass=0.1 inertia=1.0e-5 /
&lump body='f' node=3 mass=0.4 inertia=1.0e-3 /
&joint name='pin' type='revolute' body_a='f' node_a=1 /
&sensor name='rod' quantity='angle' body='f' /
"""
SHAFT = """&scene title='disc on a viscoelastic spring' /
&body name='disc' kind='rigid' mass=1.0 inertia={inertia} angular_velocity=1.0 /
&joint name='axle' type='revolute' body_a='disc' /
&spring name='shaft' type='torsional' body_a='disc' stiffness=1.0 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=1.0e3 /
&sensor name='rod' quantity='angle' body='disc' /
"""
SCENES = {
    "heavy_disc": SHAFT.format(inertia=1.0),
    "crank_1": CRANK.format(ghm="", elements=1, axial=""),
    "crank_1_bending": CRANK.format(ghm="", elements=1, axial="axial=.false."),
    "crank_2": CRANK.format(ghm="", elements=2, axial=""),
    "crank_2_bending": CRANK.format(ghm="", elements=2, axial="axial=.false."),
    "crank_8": CRANK.format(ghm="", elements=8, axial=""),
    "crank_16": CRANK.format(ghm="", elements=16, axial=""),
    "real_pole": CRANK.format(ghm="ghm_alpha=0.5 ghm_zeta=20.0 ghm_omega=5000.0", elements=2, axial=""),
    "complex_pole": CRANK.format(ghm="ghm_alpha=0.5 ghm_zeta=0.3 ghm_omega=500000.0", elements=4, axial=""),
    "two_poles": CRANK.format(ghm="ghm_alpha=0.5,2.0 ghm_zeta=1.2,4.0 ghm_omega=3.0e4,3.0e4", elements=2, axial="axial=.false."),
    "four_bar": FOUR_BAR,
    "arm": ARM,
    "frame": FRAME,
}


def transient(method, step, t_end):
    return (
        f"&transient t_end={t_end:.9e} method='{method}' step={step:.12e} output_step={50 * step:.12e} accept_unstable=.true. /\n"
    )


def march(run_deck, scene, method, step, periods_time):
    """Runs about the given time; (survived, smallest current bound). A residual of half the energy counts as lost."""
    outputs = max(1, round(periods_time / (50 * step)))
    run = run_deck(scene + transient(method, step, outputs * 50 * step), expect=None)
    energy = run.energy
    largest = max(abs(energy[name]).max() for name in ("kinetic", "potential", "dissipated", "work"))
    return run.status == 0 and abs(energy["residual"]).max() <= 0.5 * largest, run.transient.get("smallest_bound")


def safe_bound(run_deck, scene, method):
    text = run_deck(scene + transient(method, 1e-9, 1e-6), "--check").stdout
    return float(re.search(method + r": safe bound\s+(\S+)", text).group(1))


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
@pytest.mark.parametrize("name", SCENES)
def test_bounds_against_runs(name, method, run_deck):
    """Beyond its bound on the imaginary axis dopri5 grows by 1e-5 to 1e-3 a step: there divergence comes late.

    For undamped modes the observed limit of dopri5 is therefore that of divergence within the run, at most twice the
    bound; test_growth_of_the_limiting_mode looks closer.
    """
    scene = SCENES[name]
    safe = safe_bound(run_deck, scene, method)
    time = 1000 * 2 * math.pi * safe / {"rk4": 2.785, "dopri5": 0.997}[method]
    alive, bound = march(run_deck, scene, method, 0.98 * safe, time)
    assert alive, "a run below 0.98 of the safe bound diverged"
    assert bound is not None
    slow = method == "dopri5" and name not in ("complex_pole", "two_poles", "heavy_disc")
    low, high = 0.98 * safe, (2.4 if slow else 1.5) * bound
    assert not march(run_deck, scene, method, high, time)[0], "far above every bound and stable"
    for _ in range(6):
        middle = math.sqrt(low * high)
        if march(run_deck, scene, method, middle, time)[0]:
            low = middle
        else:
            high = middle
    assert low < (2.2 if slow else 1.05) * bound
    assert high > 0.95 * bound


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_growth_of_the_limiting_mode(method, run_deck):
    """On the spinning arm the amplitude of the limiting (axial) mode falls at 0.95 of the bound and grows at 1.05."""
    scene = ARM + "&sensor name='u' quantity='coordinate' body='arm' index=10 /\n"
    safe = safe_bound(run_deck, scene, method)
    bound = march(run_deck, scene, method, 0.9 * safe, 2000 * safe)[1]
    omega = {"rk4": 2.8284271, "dopri5": 0.997}[method] / bound
    for factor, grows in ((0.95, False), (1.05, True)):
        step = factor * bound
        rows = 60 * round(1000 * 2 * math.pi / omega / step / 60)
        rows = min(rows, 2400) if method == "rk4" and grows else rows
        text = transient(method, step, rows * step).replace(f"output_step={50 * step:.12e}", "")
        run = run_deck(scene + text, expect=None)
        wave = run.history["u.qdd"]
        third = len(wave) // 3
        first, last = (amplitude(part, step, omega) for part in (wave[:third], wave[-third:]))
        assert (last > 1.03 * first) if grows else (last < first), factor


def amplitude(wave, step, omega):
    """Largest component of a record within 12 % of an angular frequency, with a Hann window."""
    spectrum = np.abs(np.fft.rfft(wave * np.hanning(len(wave))))
    frequency = 2 * np.pi * np.fft.rfftfreq(len(wave), step)
    return spectrum[np.abs(frequency / omega - 1) < 0.12].max()


@pytest.mark.parametrize("inertia", [1.0, 1e-4, 2e-6, 1e-9])
def test_poles_of_a_spring_see_its_disc(inertia, run_deck):
    """The bound is that of the exact eigenvalues, from a disc that hardly moves to one that hardly resists."""
    alpha, omega, stiffness = 0.5, 1.0e3, 1.0
    matrix = np.zeros((4, 4))
    matrix[0, 1] = matrix[2, 3] = 1.0
    matrix[1, [0, 2]] = -stiffness * (1 + alpha) / inertia, stiffness * alpha / inertia
    matrix[3] = omega**2, 0.0, -(omega**2), -2 * omega
    roots = np.linalg.eigvals(matrix)
    steps = np.linspace(0.5, 4.0, 20001) / abs(roots).max()
    z = steps * roots[:, None]
    unstable = (abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) > 1 + 1e-9).any(axis=0)
    assert safe_bound(run_deck, SHAFT.format(inertia=inertia), "rk4") == pytest.approx(steps[unstable.argmax()], rel=1e-3)


def test_the_summary_tells_of_a_step_above_the_current_bound(run_deck):
    """dopri5 slightly beyond its bound grows so slowly that the run ends: the summary says so, below the bound it does not."""
    safe = safe_bound(run_deck, ARM, "dopri5")
    for factor, told in ((1.1, True), (0.9, False)):
        step = factor * safe
        run = run_deck(ARM + transient("dopri5", step, 2000 * step), name=f"at_{factor}")
        assert ("times the smallest current bound" in run.summary) == told
        assert ("times the smallest current bound" in run.stderr) == told


def test_a_wave_speed_formula_would_be_wrong(run_deck):
    """For the frame of two materials with lumps 2 (or 2.83 over 2 sqrt 3 / L c) misses the bound by more than 20 %."""
    safe = safe_bound(run_deck, SCENES["frame"], "rk4")
    elements = [(0.2, 3.0e9, 1200.0), (math.hypot(0.15, 0.1), 2.1e11, 7850.0), (math.hypot(0.05, 0.2), 3.0e9, 1200.0)]
    courant = 2.828 / max(2 * math.sqrt(3.0) / length * math.sqrt(e / rho) for length, e, rho in elements)
    assert abs(courant / safe - 1) > 0.2


def test_a_step_above_the_bound_is_refused(run_deck):
    scene = SCENES["crank_2"]
    safe = safe_bound(run_deck, scene, "rk4")
    above = scene + transient("rk4", 1.05 * safe, 1e-2).replace("accept_unstable=.true.", "")
    refused = run_deck(above, expect=2, name="refused")
    assert "above the safe bound of rk4" in refused.stderr
    assert "an axial mode of body" in refused.stderr
    assert not refused.folder.exists()
    assert "above the safe bound" in run_deck(above, "--check", name="refused").stderr
    run_deck(scene + transient("rk4", 0.99 * safe, 1e-2).replace("accept_unstable=.true.", ""), name="accepted")


@pytest.mark.parametrize(("elements", "safe", "aligned"), [(1, 35939.0, 17970.0), (2, 71878.0, 58402.0), (8, 836892.0, 834160.0)])
def test_published_frequencies(elements, safe, aligned, run_deck):
    """Largest frequencies of the paper's slider-crank, joints released and at the aligned start (theory, section 8)."""
    text = run_deck(CRANK.format(ghm="", elements=elements, axial="") + transient("rk4", 1e-9, 1e-6), "--check").stdout
    bounds = [float(x) for x in re.search(r"rk4: safe bound\s+(\S+).*current bound\s+(\S+)", text).groups()]
    assert 2.8284271 / bounds[0] == pytest.approx(safe, rel=2e-4)
    assert 2.8284271 / bounds[1] == pytest.approx(aligned, rel=2e-4)


def test_the_bound_of_a_slow_motion_is_followed(run_deck):
    """A spring of 1/4 N/m on 1 kg: 0.5 rad/s, bound 2 sqrt(2)/0.5 s; frequencies below 1 rad/s count as others do."""
    run = run_deck(
        "&body name='a' mass=1.0 inertia=1.0 /\n&joint name='j' type='prismatic' body_a='a' /\n"
        "&spring name='k' type='linear' body_a='a' point_b=-1,0 stiffness=0.25 free_length=0.9 /\n"
        "&transient t_end=10 step=0.1 output_step=1 /\n"
    )
    assert run.transient["smallest_bound"] == pytest.approx(4.0 * math.sqrt(2.0), rel=1e-3)


def test_a_vibration_far_above_the_static_stiffness_is_a_mode(run_deck):
    """A slow GHM term of weight 3 doubles the frequency of 100 rad/s: a mode of the spring, no pole of its term.

    The bound of a beam whose terms hardly relax is that of the instantaneous modulus.
    """
    told = run_deck(
        "&body name='b' mass=1.0 inertia=1.0 /\n&joint name='j' type='prismatic' body_a='b' /\n"
        "&spring name='s' type='linear' body_a='b' point_b=-1.0,0.0 stiffness=1e4 ghm_alpha=3.0 ghm_zeta=0.2 ghm_omega=50.0 /\n"
        "&transient t_end=0.1 method='rk4' step=1e-3 /\n",
        "--check",
    ).stdout
    roots = np.roots([1.0, 20.0, 2500.0 + 4e4, 20.0 * 4e4, 2500.0 * 1e4])  # (s2 + k)(s2 + 20 s + 2500) + 3 k (s2 + 20 s)
    found = re.search(r"limited by a mode of springs and rigid bodies, \|eigenvalue\| +(\S+) rad/s", told)
    assert float(found[1]) == pytest.approx(np.abs(roots).max(), rel=1e-4)
    beam = "&material name='m' density=1500.0 {} /\n&section name='s' shape='rectangle' width=0.02 height=0.02 /\n"
    beam += "&body name='a' kind='beam' length=0.5 elements=1 material='m' section='s' axial=.false. reference='clamped' /\n"
    soft, stiff = (beam.format(words) for words in ("young=3e9 prony_alpha=30.0 prony_tau=1e3", "young=93e9"))
    assert safe_bound(run_deck, soft, "rk4") == pytest.approx(safe_bound(run_deck, stiff, "rk4"), rel=1e-3)


def test_a_motion_that_springs_drive_away_belongs_to_no_body(run_deck):
    told = run_deck(
        "&body name='b' mass=2.0 inertia=0.5 /\n&joint name='j' type='prismatic' body_a='b' /\n"
        "&history name='h' kind='polynomial' coefficients=0.0,-3.0 /\n"
        "&spring name='k' type='linear' body_a='b' point_b=0.3,0.0 characteristic='h' free_length=0.2 damping=0.4 /\n"
        "&transient t_end=0.01 method='rk4' step=1e-3 /\n",
        "--check",
    ).stdout
    found = re.search(r"limited by dampers on a mode of springs and rigid bodies, \|eigenvalue\| +(\S+) rad/s", told)
    assert float(found[1]) == pytest.approx((0.4 + math.sqrt(0.4**2 + 4 * 2 * 3)) / 4, rel=1e-4)  # 2 s2 + 0.4 s - 3


def test_a_pole_of_a_slow_spring_beside_a_fast_one_sees_its_mass(run_deck):
    """A GHM term of 1000 rad/s decays with 1149 1/s where its spring carries 1 kg; the other's mode allows more."""
    told = run_deck(
        "&body name='a' mass=1.0 inertia=1.0 /\n&joint name='ga' type='prismatic' body_a='a' /\n"
        "&body name='b' mass=1.0 inertia=1.0 /\n&joint name='gb' type='prismatic' body_a='b' /\n"
        "&spring name='s' type='linear' body_a='a' point_b=-1.0,0.0 stiffness=9e5 /\n"
        "&spring name='t' type='linear' body_a='b' point_b=-1.0,0.0 stiffness=1e3 ghm_alpha=30.0 ghm_zeta=1.0 ghm_omega=1e3 /\n"
        "&transient t_end=0.01 step=1e-4 method='rk4' /\n",
        "--check",
    ).stdout
    roots = np.roots([1.0, 2e3, 1e6 + 31e3, 2e3 * 31e3, 1e6 * 1e3])  # (s2 + k)(s2 + 2e3 s + 1e6) + 30 k (s2 + 2e3 s)
    assert float(re.search(r"rk4: safe bound +(\S+) s", told)[1]) == pytest.approx(2.785294 / np.abs(roots).max(), rel=1e-4)


GHM_ROD = """&material name='m' density=1600.0 young=2.1e7 ghm_alpha=0.4 ghm_zeta=5.0 ghm_omega=1.0e6 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='rod' kind='beam' length=0.3 elements=2 material='m' section='s' angular_velocity=3.0 /
&joint name='a' type='revolute' body_a='rod' node_a=1 /
&transient t_end=1e-5 method='rk4' step=1.0e-7 /
"""
OVERDAMPED = """&body name='b' mass=1.0 inertia=1.0 /
&joint name='j' type='prismatic' body_a='b' /
&spring name='s' type='linear' body_a='b' point_b=-1.0,0.0 stiffness=1e4 damping=1e3 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=60.0 /
&transient t_end=1.0 method='rk4' step=1e-3 /
"""
DEAD_CENTRE = """&body name='b' mass=1.0 inertia=1.0 angular_velocity=5.0 /
&joint name='j' type='revolute' body_a='b' /
&spring name='s' type='linear' body_a='b' point_a=0.5,0.0 point_b=1.5,0.0 stiffness=1e4 free_length=0.9 /
&transient t_end=1.0 method='rk4' step=1e-3 /
"""


@pytest.mark.parametrize(
    ("deck", "cause", "expected"),
    [(GHM_ROD, "GHM pole", "safe_bound"), (OVERDAMPED, "dampers on", "current_bound"), (DEAD_CENTRE, "a mode of springs", None)],
)
def test_the_bound_is_estimated_along_every_run(run_deck, deck, cause, expected):
    """Where a term's pole limits the step, an overdamped mode, or nothing at the start, since the spring points at the joint."""
    run = run_deck(deck)
    found = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
    assert found["stable_steps"]["rk4"]["limited_by"].startswith(cause)
    assert found["transient"]["bound_estimates"] > 5
    if expected:
        assert found["transient"]["smallest_bound"] == pytest.approx(found["stable_steps"]["rk4"][expected], rel=1e-4)
    else:
        assert found["stable_steps"]["rk4"]["safe_bound"] < found["transient"]["smallest_bound"] < 1.0
    assert ("stable as long as forces of springs stay as at the start" in run.summary) == (expected is None)
