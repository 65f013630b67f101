"""Results in the formats of other programs: CSV, HDF5, Parquet, MATLAB, VTK."""

from __future__ import annotations

import argparse
import csv
import re
from pathlib import Path

import numpy as np

from .histories import History, read
from .mechanism import Mechanism, from_run
from .result_files import INNER, TABLES, HistoryError, note

UNITS = "units"  # structure of a MATLAB file with the unit of each column
EXTRAS = {"parquet": "tables", "hdf5": "hdf5", "csv": "", "matlab": "", "vtk": ""}  # of the package, by format


def matlab_names(names: list[str]) -> list[str]:
    """Return names that MATLAB takes for variables: letters, digits and _, up to 63, each once, and none the structure of units."""
    made = [UNITS]
    for name in names:
        word = re.sub(r"\W", "_", name)
        word = (word if word[0].isalpha() else f"x{word}")[:60]
        count = sum(other == word or other.startswith(f"{word}__") for other in made)
        made.append(f"{word}__{count}" if count else word)
    return made[1:]


def write_table(run: History, form: str, path: Path) -> None:
    """Write one results file as CSV, Parquet or MATLAB; OSError where it cannot be written."""
    if form == "matlab":
        from scipy.io import savemat

        words = matlab_names(run.names)
        columns = {word: run[name] for word, name in zip(words, run.names)}
        units = {word: run.units[name] for word, name in zip(words, run.names)}
        savemat(path, columns | {UNITS: units}, oned_as="column", long_field_names=True)
    elif form == "hdf5":
        import h5py

        with h5py.File(path, "w") as file:
            for name in run.names:
                file.create_dataset(name, data=run[name], compression="gzip").attrs["unit"] = run.units[name]
    elif form == "parquet":
        from pyarrow import Table, parquet  # pandas would tell of its absence in many lines

        parquet.write_table(Table.from_pandas(run.to_dataframe()), path)
    else:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(run.columns())
            writer.writerows(run.data.tolist())


def lines(scene: Mechanism, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points [m], pairs of points and each pair's part, at one time: bodies, then massless links, then springs."""
    points, pairs, part = [], [], []

    def add(track: np.ndarray, joined: list[tuple[int, int]], number: int) -> None:
        first = sum(map(len, points))
        points.append(np.column_stack([track, np.zeros(len(track))]))
        pairs.extend((first + i, first + j) for i, j in joined)
        part.extend([number] * len(joined))

    number = 0
    for number, body in enumerate(scene.bodies.values(), 1):
        if len(body.rest):
            track = body.to_global(row, scene.nodes(body, row))
            add(track, body.elements or [(k, k + 1) for k in range(len(track) - 1)], number)
        else:
            track = scene.outline(body, row)
            add(track, [(k, k + 1) for k in range(len(track) - 1)], number)
    for ends in scene.links + scene.springs:
        number += 1
        add(np.array([scene.position(marker, row) for marker in ends]), [(0, 1)], number)
    return np.concatenate(points), np.array(pairs).reshape(-1, 2), np.array(part)


def write_vtk(scene: Mechanism, folder: Path) -> Path:
    """Write a file a time and the collection that ParaView opens; returns its path; OSError where they cannot be written."""
    import meshio

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "motion.pvd"
    if path.is_file():  # its own files of a longer motion
        for name in re.findall(r'file="(motion_\d+\.vtu)"', path.read_text(encoding="utf-8", errors="replace")):
            (folder / name).unlink(missing_ok=True)
    entries = []
    for row, time in enumerate(scene.time):
        points, pairs, part = lines(scene, row)
        name = f"motion_{row:06d}.vtu"
        meshio.write(folder / name, meshio.Mesh(points, [("line", pairs)], cell_data={"part": [part]}))
        entries.append(f'<DataSet timestep="{float(time)!r}" file="{name}"/>')
    body = "\n".join(entries)
    text = f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n{body}\n</Collection>\n</VTKFile>\n'
    path.write_text(text, encoding="utf-8")
    note(path, *(folder / f"motion_{row:06d}.vtu" for row in range(len(scene.time))))
    return path


def export(args: argparse.Namespace) -> int:
    """Write every run; raises HistoryError."""
    if args.output and len(args.runs) > 1:
        raise HistoryError("--output goes with one RUN")
    for source in args.runs:
        run = read(source, "motion" if args.to == "vtk" else args.file)
        try:
            if args.to == "vtk":
                path = write_vtk(from_run(run), args.output or run.path.parent / INNER)
            else:
                path = args.output or run.path.with_suffix(TABLES[args.to])
                write_table(run, args.to, path)
                note(path)
        except ImportError as fault:
            library = (fault.name or "").partition(".")[0]
            wanted = f"'biela[{EXTRAS[args.to]}]'" if EXTRAS[args.to] else library
            raise HistoryError(f"--to {args.to}: the library {library} is missing: pip install {wanted}") from None
        except OSError as fault:
            raise HistoryError(f"{fault.filename or args.output}: cannot be written ({fault.strerror or fault})") from None
        print(f"wrote {path}")
    return 0
