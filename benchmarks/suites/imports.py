"""What it costs to import a package, and to reach through its door, in a fresh interpreter."""


class Imports:
    """Each statement runs in an interpreter of its own."""

    params = ("signals", "hums", "data_synth", "signals.track_orders", "hums.analyze")
    param_names = ("name",)

    def timeraw_import(self, name: str) -> str:
        """Time `import package`, and where a name follows it, asking for that."""
        return f"import {name.partition('.')[0]}; {name}"
