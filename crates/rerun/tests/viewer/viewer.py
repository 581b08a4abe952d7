"""What the viewer finds in a recording."""

import pyarrow
from rerun.server import Server


class Recording:
    """A file, opened by the loader of the viewer."""

    def __init__(self, path):
        self.server = Server(datasets={"run": [str(path)]})
        self.data = self.server.client().get_dataset("run")
        self.names = [c.name for c in self.data.schema().component_columns()]
        self.entities = {name.rsplit(":", 2)[0] for name in self.names if name.startswith("/")}

    def close(self):
        self.server.shutdown()

    @staticmethod
    def find(table, entity, component):
        names = table.schema.names
        return table.column(next(n for n in names if n.startswith(f"{entity}:") and n.endswith(f":{component}")))

    def column(self, entity, component, index="time"):
        """Times and values of one component of an entity, where it was set."""
        table = self.data.filter_contents([entity]).reader(index=index).to_arrow_table()
        # Time stamps and durations alike become nanoseconds.
        times = table.column(index).cast(pyarrow.int64()).to_pylist()
        values = self.find(table, entity, component).to_pylist()
        return [(t, v) for t, v in zip(times, values) if v is not None]

    def last(self, entity, component):
        """The last value."""
        return self.column(entity, component)[-1][1]

    def static(self, entity, component):
        """A value for the whole recording."""
        table = self.data.filter_contents([entity]).reader(index=None).to_arrow_table()
        return next(v for v in self.find(table, entity, component).to_pylist() if v is not None)
