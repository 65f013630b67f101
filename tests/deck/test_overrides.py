"""`--set GROUP/NAME/KEY=VALUE`, and the same in an &include: values, items, keys and groups; what such a setting cannot name."""

from __future__ import annotations

import json

import pytest

PART = "&parameter name='W' value=1 /\n&body name='b' mass=1 inertia={W} /\n&scene title='a part' /\n"
DECK = """&parameter name='L' value=0.3 /
&include file='part.nml' prefix='a_' set='body/b/mass=3','W=2' /
&section name='s' shape='rectangle' width={2*L}, ! a comment, it stays
   height=0.004 /
&material name='m' density=1200 young=3e9 ghm_alpha=0.3,0.2 ghm_zeta=2*1.5 ghm_omega=600,7d2 /
&body name='c' kind='beam' length={L} elements=2 material='m' section='s' reference='clamped' /
&sensor name='f' quantity='angle' body='a_b' /
&transient t_end=1, tolerance=1e-6 method='dopri5' output_step=0.1 /
"""


@pytest.fixture
def said(biela, tmp_path):
    """Return a function that calls the solver with settings on the deck."""
    import subprocess

    (tmp_path / "part.nml").write_text(PART)
    (tmp_path / "deck.nml").write_text(DECK)

    def call(*settings: str, option: str = "--json"):
        words = [word for one in settings for word in ("--set", one)]
        return subprocess.run([biela, "--flat", *[option] * bool(option), *words, "deck.nml"], cwd=tmp_path, capture_output=True,
                              text=True, check=False)  # fmt: skip

    return call


def group(done, kind, name=""):
    """Return the values of a group."""
    return next(one for one in json.loads(done.stdout) if one["group"] == kind and (not name or one["name"] == [name]))


def test_groups_are_listed_with_their_values(said):
    found = said()
    assert group(found, "body", "a_b") == {"group": "body", "name": ["a_b"], "mass": [3], "inertia": [2]}
    assert group(found, "section")["width"] == [0.6]
    assert group(found, "material")["ghm_zeta"] == [1.5, 1.5]
    assert group(found, "material")["ghm_omega"] == [600, 700]
    assert group(found, "transient")["method"] == ["dopri5"]


@pytest.mark.parametrize(
    ("setting", "kind", "key", "value"),
    [
        ("section/s/width={2*L + 1}", "section", "width", [1.6]),
        ("SECTION/S/Height=0.01", "section", "height", [0.01]),
        ("material/m/ghm_alpha(2)=0.5", "material", "ghm_alpha", [0.3, 0.5]),
        ("material/m/ghm_zeta=1,2", "material", "ghm_zeta", [1, 2]),
        ("body/a_b/mass=7", "body", "mass", [7]),
        ("body/c/viscoelastic=.false.", "body", "viscoelastic", [False]),
        ("transient/t_end=", "transient", "t_end", None),
        ("scene/title='it''s'", "scene", "title", ["it's"]),
    ],
)
def test_a_value_is_set(said, setting, kind, key, value):
    name = setting.lower().split("/")[1] if setting.count("/") == 2 else ""
    found = said(setting, option="" if value is None else "--json")
    if value is None:  # it is missing then
        assert found.stderr == "deck.nml:8: transient: t_end is missing, expected t_end > 0\n"
    else:
        assert group(found, kind, name)[key] == value


def test_a_group_goes_and_the_rest_of_the_text_stays(said):
    text = said("sensor/f/=", "section/s/height=0.01", "transient/tolerance=", "transient/step=1e-6", option="").stdout
    assert "&sensor" not in text
    assert "width=0.6, ! a comment, it stays\n   height=0.01 /\n" in text
    assert "&transient t_end=1,  method='dopri5' output_step=0.1  step=1e-6 /" in text


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("secton/s/height=1", "deck.nml: --set secton/s/height=1 names no kind of group, did you mean section?"),
        ("section/x/height=1", "deck.nml: --set section/x/height=1 names 0 groups of the deck, expected one: GROUP/NAME/KEY=VALUE"),
        ("body/mass=1", "deck.nml: --set body/mass=1 names 2 groups of the deck, expected one: GROUP/NAME/KEY=VALUE"),
        ("section/s/heigt=1", "deck.nml:4: section/s: unknown variable heigt"),
        ("material/m/young=abc", "deck.nml:5: material/m: young=abc is not a number"),
        ("material/m/ghm_zeta(1)=1", "names no single value"),
        ("material/m/ghm_omega(3)=1", "names no single value"),
        ("material/m/ghm_omega(0)=1", "names no single value"),
        ("material/m/ghm_omega(12345678901)=1", "names no single value"),
        ("material/m/ghm_omega(-1)=1", "names no single value"),
        ("material/m/ghm_omega()=1", "names no single value"),
        ("material/m/ghm_omega(2=1", "names no single value"),
        ("material/m/ghm_omega(2)=3*5", "--set material/m/ghm_omega(2)=3*5 has 3 values, expected the one that it names"),
        ("material/m/ghm_omega(2)=5 6", "has 2 values, expected the one that it names"),
        ("material/m/ghm_omega(2)=", "has 0 values, expected the one that it names"),
        ("material/m/young=3e9 poisson=0.4", "has no value as decks have it"),
        ("material/m/young=3e9 ! more", "has no value as decks have it"),
        ("material/m/young=3e9 / &scene", "has no value as decks have it"),
        ("transient/t_end=1 /&body", "deck.nml"),
    ],
)
def test_what_cannot_be_set_is_told(said, setting, told):
    done = said(setting)
    assert (done.returncode, done.stdout) == (2, "")
    assert told in done.stderr.splitlines()[0]


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        (["body/a_b/mass=2", "body/a_b/mass=3"], "body/a_b/mass=3 sets body/a_b/mass"),
        (["BODY/A_B/Mass=2", "body/a_b/mass=2"], "body/a_b/mass=2 sets body/a_b/mass"),
        (["section/s/width=2", "section/width=3"], "section/width=3 sets section/s/width"),
        (["material/m/ghm_alpha(2)=1", "material/m/ghm_alpha(2)=2"], "material/m/ghm_alpha(2)=2 sets material/m/ghm_alpha"),
        (["material/m/ghm_alpha=1,2", "material/m/ghm_alpha(2)=2"], "material/m/ghm_alpha(2)=2 sets material/m/ghm_alpha"),
        (["sensor/f/=", "sensor/f/body='c'"], "sensor/f/body='c' sets sensor/f/body"),
        (["transient/t_end=2", "transient/t_end="], "transient/t_end= sets transient//t_end"),
        (["L=1", "parameter/L/value=2"], "parameter/L/value=2 sets parameter/l/value"),
        (["parameter/L/value=2", "L=1"], "parameter/L/value=2 sets parameter/l/value"),
    ],
)
def test_a_key_is_set_once(said, settings, what):
    done = said(*settings)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"deck.nml: --set {what} twice, expected one value" in done.stderr.splitlines()


def test_items_of_one_list_and_keys_of_one_group_are_set_together(said):
    found = said("material/m/ghm_alpha(2)=0.9", "material/m/ghm_alpha(1)=0.8", "body/a_b/mass=2", "body/a_b/inertia=3", "L=1")
    assert group(found, "material")["ghm_alpha"] == [0.8, 0.9]
    assert group(found, "body", "a_b") == {"group": "body", "name": ["a_b"], "mass": [2], "inertia": [3]}


SCOPE = {
    "inner/leaf.nml": "&parameter name='h' value=0.1 /\n&material name='m' density=1 young=1e9 /\n"
    "&body name='b' kind='beam' length={h} elements=2 material='m' section='s' /\n"
    "&history name='t' kind='table' file='t.csv' interpolation='linear' /\n",
    "inner/t.csv": "0 1\n1 1\n",
    "t.csv": "0 2\n1 2\n",
    "middle.nml": "&parameter name='h' value=3 /\n&include file='inner/leaf.nml' prefix='i_' set='body/b/length={2*h}' /\n",
    "deck.nml": """&parameter name='h' value=7 /
&section name='s' area=1e-4 inertia=1e-9 /
&material name='m' density=9 young=1e9 /
&include file='inner/leaf.nml' prefix='p_' set='body/b/length={h}',"body/b/material='m'","history/t/file='t.csv'",
  'parameter/h/value={h+1}' /
&include file='inner/leaf.nml' prefix='q_' /
&include file='middle.nml' prefix='r_' set='body/i_b/elements={h-4}' /
""",
}


def test_a_setting_means_the_names_and_the_folder_of_the_file_in_which_it_stands(biela, tmp_path):
    """Expressions, names and paths, through parts of parts; those of the command line the deck's."""
    import subprocess

    (tmp_path / "inner").mkdir()
    for name, text in SCOPE.items():
        (tmp_path / name).write_text(text)

    def flat(*words: str):
        return subprocess.run([biela, "--flat", *words, "deck.nml"], cwd=tmp_path, capture_output=True, text=True, check=False)

    found = flat("--json")
    bodies = {name: group(found, "body", name) for name in ("p_b", "q_b", "r_i_b")}
    assert {name: (b["length"], b["elements"], b["material"]) for name, b in bodies.items()} == {
        "p_b": ([7], [2], ["m"]),
        "q_b": ([0.1], [2], ["q_m"]),
        "r_i_b": ([6], [3], ["r_i_m"]),
    }
    assert group(found, "history", "p_t")["file"] == [str(tmp_path / "t.csv")]
    assert group(found, "history", "q_t")["file"] == [str(tmp_path / "inner/t.csv")]
    assert "&parameter name='p_h' value=8 /" in flat().stdout
    assert group(flat("--json", "--set", "body/q_b/length={h/7}"), "body", "q_b")["length"] == [1]
    told = flat("--set", "body/q_b/length={none}").stderr
    assert "length={none} has the unknown name none" in told


@pytest.mark.parametrize(("word", "value"), [("false", False), (".F.", False), ("T", True), ("True", True), (".true.", True)])
def test_logical_values_are_those_of_json(said, word, value):
    assert group(said(f"body/c/viscoelastic={word}"), "body", "c")["viscoelastic"] == [value]
