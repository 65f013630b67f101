"""The folders of src depend only downward; the `use` lines say whether they do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT

# What each folder may use, besides itself. The deck and the model do not see each other; integrators know no mechanics.
MAY_USE = {
    "base": set(),
    "algebra": {"base"},
    "deck": {"base", "algebra"},
    "model": {"base", "algebra"},
    "build": {"base", "deck", "model"},
    "system": {"base", "algebra", "model"},
    "closing": {"base", "system"},
    "integrate": {"base", "algebra"},
    "modes": {"base", "algebra", "model", "system"},
    "stability": {"base", "algebra", "model", "system", "integrate", "modes"},
    "output": {"base", "deck", "model", "build", "system", "closing", "modes"},
    "analysis": {"base", "algebra", "deck", "model", "build", "system", "closing", "integrate", "modes", "stability", "output"},
    ".": {"base", "algebra", "analysis"},
}
FROM_KEYS = {"deck_keys", "deck_values", "deck_take"}  # modules that the Makefile makes (KEYS, VERSION)
MODULE = re.compile(r"^\s*module\s+(?!procedure\b|subroutine\b|function\b)(\w+)\s*(?:!.*)?$", re.IGNORECASE | re.MULTILINE)
USE = re.compile(r"^\s*use\b\s*(?:,\s*(intrinsic)\s*)?(?:::)?\s*(\w+)", re.IGNORECASE | re.MULTILINE)


def sources(src: Path) -> dict[Path, str]:
    """Return the text of every source file."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(src.rglob("*.f90"))}


def layer(path: Path, src: Path) -> str:
    """Return the folder of src that a file is in, at whatever depth."""
    return (*path.relative_to(src).parts[:-1], ".")[0]


def faults(src: Path) -> list[str]:
    """Return one line for each `use` that the order of the folders does not allow, and for each unknown folder or module."""
    texts = sources(src)
    home = {name.lower(): path for path, text in texts.items() for name in MODULE.findall(text)}
    home |= {f"complex_{name}": path for name, path in home.items() if "real(number)" in texts[path]}  # the Makefile's TWINS
    home |= {**dict.fromkeys(FROM_KEYS, src / "deck" / "keys.txt"), "program_version": src / "output" / "summary.f90"}
    found = []
    for path, text in texts.items():
        folder = layer(path, src)
        if folder not in MAY_USE:
            found.append(f"{path.name}: folder {folder} has no place in the order")
            continue
        for intrinsic, name in USE.findall(text):
            if intrinsic:
                continue
            if name.lower() not in home:
                found.append(f"{path.name} uses {name}, which no file defines")
                continue
            below = layer(home[name.lower()], src)
            if below != folder and below not in MAY_USE[folder]:
                found.append(f"{path.name} ({folder}) uses {name} ({below})")
    return found


def test_use_lines_point_downward():
    assert sources(ROOT / "src"), "no sources found"
    assert faults(ROOT / "src") == []


def test_the_deck_language_knows_no_groups():
    records = {path.stem for path in (ROOT / "src" / "deck" / "groups").glob("*.f90")} | {"deck_values", "deck_take"}
    texts = {path: text for path, text in sources(ROOT / "src").items() if path.parent.name == "language"}
    assert texts
    assert records
    assert [path.name for path, text in texts.items() if records & {name for _, name in USE.findall(text)}] == []


def test_each_module_is_named_as_its_file():
    for path, text in sources(ROOT / "src").items():
        names = [name.lower() for name in MODULE.findall(text)]
        assert names in ([path.stem], [] if path.name == "main.f90" else None), f"{path} defines {names}"


def test_the_map_names_folders_and_what_they_may_use():
    text = (ROOT / "src" / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)/` \|[^|]*\| ([^|]*) \|$", text, re.MULTILINE))
    rows = {folder: set() if names == "-" else set(names.split(", ")) for folder, names in rows.items()}
    assert rows == {folder: below for folder, below in MAY_USE.items() if folder != "."}


def test_the_map_names_procedures_and_files_that_exist():
    src = ROOT / "src"
    text = (src / "README.md").read_text(encoding="utf-8")
    calls = re.findall(r"^ {4,}(\w[\w, ]*?) {2,}((?:\w+/)+\w+\.f90)", text, re.MULTILINE)
    assert len(calls) > 20, "no call trees found"
    wrong = [f"{name} in {file}" for names, file in calls for name in names.split(", ") if not defines(src / file, name)]
    wrong += [file for file in re.findall(r"[\w/]+\.f90", text) if not list(src.glob(f"**/{file}"))]
    assert wrong == [], "src/README.md names what is not there"


def test_cited_sections_exist():
    headings, missing = {}, []
    for path, text in sources(ROOT / "src").items():
        cited = re.findall(r"((?:\w+/)?README\.md), \"([^\"]+)\"", text)
        cited += [("src/theory.md", n) for n in re.findall(r"theory\.md, section (\d+)", text)]
        for file, section in cited:
            lines = headings.setdefault(file, re.findall(r"^#+ (.*)$", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE))
            if not any(line == section or line.startswith(f"{section} ") for line in lines):
                missing.append(f"{path.name}: {file}, {section}")
    assert missing == []


def defines(path: Path, procedure: str) -> bool:
    """Return whether a file defines a procedure."""
    head = rf"^(?!\s*end).*\b(?:subroutine|function) {procedure}\b"
    return path.is_file() and re.search(head, path.read_text(encoding="utf-8"), re.MULTILINE) is not None


@pytest.mark.parametrize(
    ("folder", "line", "told"),
    [
        ("base", "use joint, only: pin", "x.f90 (base) uses joint (model)"),
        ("deck", "  use :: joint", "x.f90 (deck) uses joint (model)"),
        ("model", "use nowhere, only: y", "x.f90 uses nowhere, which no file defines"),
        ("integrate", "use joint", "x.f90 (integrate) uses joint (model)"),
        ("other", "use joint", "x.f90: folder other has no place in the order"),
        ("build", "use joint", None),
        ("build", "use, intrinsic :: iso_fortran_env, only: int64", None),
    ],
)
def test_an_upward_use_is_found(tmp_path, folder, line, told):
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "joint.f90").write_text("module joint\nend module joint\n")
    (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / folder / "x.f90").write_text(f"module x\n{line}\nend module x\n")
    assert faults(tmp_path) == ([told] if told else [])


# Set-up and assembly: whoever else takes a mechanism cannot change it.
SET_UP = {"mechanism_setup", "incidence", "attachments", "prototypes", "assembly", "redundancy", "clearance_start"}


def test_mechanism_is_constant_after_set_up():
    changed = re.compile(r"type\(\s*(?:mechanism_model|scene|body_model)\s*\)\s*,\s*intent\(\s*inout", re.IGNORECASE)
    found = {
        path
        for path, text in sources(ROOT / "src").items()
        if layer(path, ROOT / "src") not in ("model", "build") and changed.search(text)
    }
    assert {path.stem for path in found} <= SET_UP
