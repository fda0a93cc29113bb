"""JSON schema of gearbox files, for editors that check while one types."""

from typing import Any

from hums.gearbox import Gearbox


def gearbox_schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of a gearbox file as it is written by hand."""
    schema: dict[str, Any] = Gearbox.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    # of the class's docstring only what describes a file, not its sections for Python
    schema["description"] = schema["description"].split("\n\n")[0]
    name = {"type": "string", "minLength": 1}
    axis, mesh, bearing = parts["Axis"], parts["Mesh"], parts["Bearing"]
    # in a file an axis is a table under its name or, in short form, the list of its links
    del axis["properties"]["name"]
    axis["required"].remove("name")
    links = axis["properties"]["links"]
    schema["properties"]["axes"] = {
        "type": "object",
        "minProperties": 1,
        "additionalProperties": {"anyOf": [links, {"$ref": "#/$defs/Axis"}]},
    }
    # in a file the gears of a mesh are in the table `teeth`, and its name defaults to theirs
    del mesh["properties"]["gears"], parts["Gear"]
    mesh["properties"]["teeth"] = {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 2,
        "additionalProperties": {"type": "integer", "not": {"const": 0}},
        "description": "Signed teeth of each gear: minus for an internal gear.",
    }
    mesh["required"] = ["teeth"]
    bearing["properties"]["name"] = name
    bearing["required"].remove("names")
    bearing["oneOf"] = [{"required": ["names"]}, {"required": ["name"]}]
    # the name defaults to that of the file
    schema["required"].remove("name")
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema
