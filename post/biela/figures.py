"""Figures of summary.json and of results by their names, `figures.scene.bodies.crank.mass`; tables of results."""

from __future__ import annotations

import html
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas


class Figures(dict):
    """Figures of summary.json, as items and as attributes: `figures.transient.steps`."""

    def __getattr__(self, name: str) -> object:
        """Return an item by its name."""
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no {name!r}; there are {', '.join(self)}") from None


class Named(list):
    """A list of figures that have names, as items and by these: `figures.scene.bodies.crank`."""

    def __getattr__(self, name: str) -> object:
        """Return an item by its name."""
        found = next((item for item in self if isinstance(item, dict) and item.get("name") == name), None)
        if found is None:
            raise AttributeError(f"no {name!r}; there are {', '.join(str(item['name']) for item in self if 'name' in item)}")
        return found


def figures(value: object) -> object:
    """Return a JSON value with its objects as `Figures`."""
    if isinstance(value, dict):
        return Figures({name: figures(item) for name, item in value.items()})
    return Named(figures(item) for item in value) if isinstance(value, list) else value


class Tabular:
    """A result with a table, `head` and `rows`; notebooks show its `report` where it has one."""

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the table, units in the names of the columns."""
        import pandas

        return pandas.DataFrame(self.rows, columns=list(self.head))

    def draw(self, name: str) -> Iterator[Path]:
        """Draw its picture into its folder when it is asked for."""
        from .picture_files import save

        yield save(self.picture(), self.folder / name)

    def _repr_html_(self) -> str:
        report = getattr(self, "report", None)
        return f"<pre>{html.escape(chr(10).join(report))}</pre>" if report else self.to_dataframe().to_html(max_rows=20)
