"""Figures of summary.json and of results, as items and by their names: `figures.scene.bodies.crank.mass`."""

from __future__ import annotations


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
