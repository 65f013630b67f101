"""A run repeats itself to the last bit, whatever the number of BLAS threads, and a long beam needs memory for its band only."""

import subprocess

from conftest import untimed

SCENE = """&scene title='two beams and a spring' gravity=0.0,-9.81 /
&material name='m' density=1500.0 young=3.0e9 ghm_alpha=0.5,0.3 ghm_zeta=1.2,0.6 ghm_omega=900.0,4000.0 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='a' kind='beam' length=0.6 elements=4 material='m' section='s' /
&body name='b' kind='beam' length=0.5 elements={elements} material='m' section='s' position=0.6,0.0 angle=-0.5 {modes} /
&joint name='j1' type='revolute' body_a='a' node_a=1 /
&joint name='j2' type='revolute' body_a='b' node_a=1 body_b='a' node_b=-1 /
&spring name='k' type='linear' body_a='b' node_a=-1 point_b=0.5,0.5 stiffness=100.0 ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=50.0 /
&sensor name='tip' quantity='acceleration' body='b' node=-1 /
&sensor name='pin' quantity='reaction' joint='j1' /
&transient t_end={t_end} method='rk4' step={step} accept_unstable=.true. /
"""


def files(run):
    """Bytes of every result, without the lines of times."""
    return {path.name: untimed(path.read_bytes()) for path in run.folder.iterdir()}


def test_bit_for_bit(run_deck):
    for modes in ("", "modes=3"):
        text = SCENE.format(elements=4, modes=modes, t_end=2e-3, step=2e-6)
        first = files(run_deck(text))
        assert set(first) == {"history.txt", "energy.txt", "summary.txt", "summary.json"}
        for threads in ("1", "2", "4"):
            again = run_deck(text, environment={"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads})
            assert files(again) == first


def test_memory_grows_with_the_band(largest, biela, tmp_path):
    """2,000 elements have 6,000 coordinates: one matrix of them alone would take 288 MB, where no array has more than 5 MB."""
    deck = tmp_path / "long.nml"
    deck.write_text(SCENE.format(elements=2000, modes="", t_end=2e-11, step=1e-12))
    done = subprocess.run([biela, "--quiet", deck], cwd=tmp_path, env=largest(5e6), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
