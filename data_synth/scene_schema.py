"""JSON schemas of scenes and plans, for editors that validate while typing."""

from collections.abc import Mapping
from typing import Any

from data_synth.plan import PlanTable
from data_synth.scene.scene import Scene

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_HISTORIES = {"Speed": ("rpm", "steps", "csv", "run_up"), "Torque": ("nm", "steps", "csv")}


def scene_schema(gearbox: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of a scene file as written by hand.

    Parameters
    ----------
    gearbox : mapping
        Schema of a gearbox file, `hums.gearbox.model.gearbox_schema()`, since a scene may contain a gearbox instead of
        naming one.

    Returns
    -------
    dict
        A JSON schema without null, which TOML does not have.
    """
    schema: dict[str, Any] = Scene.model_json_schema(by_alias=True)
    parts, properties = schema["$defs"], schema["properties"]
    box = {key: value for key, value in gearbox.items() if key not in {"$defs", "$schema"}}
    parts |= gearbox["$defs"]
    del parts["Gear"]
    parts["Gearbox"] = box | {"required": [*box["required"], "name"]}  # inside a scene there is no file name to use
    named = {"type": "string", "minLength": 1, "description": "A .toml file or a catalogue name."}
    properties["gearbox"] = {"anyOf": [named, {"$ref": "#/$defs/Gearbox"}]}
    maps = {"Excitation": ("shafts", "meshes"), "Dynamics": ("links", "meshes", "bearings", "shafts")}
    maps |= {"SensorWeights": ("links",)}
    for part, fields in maps.items():
        for field in fields:
            _as_table(parts[part]["properties"][field])
    for part, forms in _HISTORIES.items():
        _as_history(parts[part], forms)
    parts["MeshDynamics"]["properties"]["csv"] = {"type": "string", "description": "A file of mesh cycles and um."}
    transfer = parts["Transfer"]
    transfer["properties"]["csv"] = {"type": "string", "description": "A file of three columns: Hz, real, imaginary."}
    transfer["oneOf"] = [{"required": [form]} for form in ("modes", "lines", "csv")]
    return {**_without_null(schema), "$schema": _DRAFT}


def plan_schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of a plan file; `hums schema scene` lists the keys that it may change.

    Examples
    --------
    >>> from data_synth.scene_schema import plan_schema
    >>> sorted(plan_schema()["$defs"])
    ['ClassTable', 'History', 'MachineTable']
    """
    return {**_without_null(PlanTable.model_json_schema(by_alias=True)), "$schema": _DRAFT}


def _as_table(pairs: dict[str, Any]) -> None:
    """Turn the schema of a list of (name, value) into that of the table in the file."""
    value = pairs.pop("items")["prefixItems"][1]
    pairs |= {"type": "object", "propertyNames": {"minLength": 1}, "additionalProperties": value}
    if "default" in pairs:
        pairs["default"] = {}


def _as_history(history: dict[str, Any], forms: tuple[str, ...]) -> None:
    """Allow a time history in any one of its forms, including a number or a file."""
    value = history["properties"][forms[0]]
    value["anyOf"].append({"type": "number"})
    history["properties"]["csv"] = {"type": "string", "description": f"A file of two columns: s, {forms[0]}."}
    history["oneOf"] = [{"required": [form]} for form in forms]


def _without_null(value: Any) -> Any:  # noqa: ANN401
    """Return a schema without null among types and defaults, which TOML does not have."""
    if isinstance(value, list):
        return [_without_null(item) for item in value]
    if not isinstance(value, dict):
        return value
    table = {key: _without_null(item) for key, item in value.items() if not (key == "default" and item is None)}
    choices = table.get("anyOf")
    if isinstance(choices, list) and {"type": "null"} in choices:
        table["anyOf"] = [choice for choice in choices if choice != {"type": "null"}]
    return table
