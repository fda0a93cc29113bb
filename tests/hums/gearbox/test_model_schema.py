"""The schema accepts every file that the loader accepts, refuses what it refuses, and files survive a round trip."""

import copy
import tomllib
import warnings
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning, catalogue, gearbox_schema, load_gearbox

FILES = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in catalogue().items()}
VALIDATOR = Draft202012Validator(gearbox_schema())


@pytest.fixture(autouse=True)
def _warnings_are_not_the_point():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)
        yield


def test_the_schema_is_a_schema():
    Draft202012Validator.check_schema(gearbox_schema())


@pytest.mark.parametrize("name", FILES)
def test_to_toml_and_back_is_the_identity_and_fits_the_schema(name, tmp_path):
    gearbox = load_gearbox(name)
    (tmp_path / "box.toml").write_text(gearbox.to_toml(), encoding="utf-8")
    assert load_gearbox(tmp_path / "box.toml") == gearbox
    for table in (FILES[name], tomllib.loads(gearbox.to_toml())):
        assert list(VALIDATOR.iter_errors(table)) == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda table: table.pop("frame"),
        lambda table: table["mesh"][0].update(teeht=1),
        lambda table: table["mesh"][0].update(teeth={"sun": "27"}),
        lambda table: table["mesh"][0].update(kind="hypoid"),
        lambda table: table["mesh"][0].update(helix_angle_deg=10.0, hand="up"),
        lambda table: table["bearing"][0].update(elements=1),
        lambda table: table["axes"].update(extra=["housing"]),
    ],
)
def test_what_the_loader_refuses_does_not_fit(spoil):
    table = copy.deepcopy(FILES["planetary-27-36-99"])
    spoil(table)
    assert list(VALIDATOR.iter_errors(table))
    with pytest.raises(GearboxError):
        Gearbox.from_mapping(table)


def test_every_field_is_described_in_schema_and_documentation():
    schema = gearbox_schema()
    tables = {"Gearbox": schema} | schema["$defs"]
    page = (Path(__file__).parents[3] / "docs" / "gearbox_files.md").read_text(encoding="utf-8")
    fields = [(table, name, field) for table, part in tables.items() for name, field in part["properties"].items()]
    assert len(fields) > 35
    assert [(table, name) for table, name, field in fields if not field.get("description", "").endswith(".")] == []
    assert [(table, name) for table, name, field in fields if f"| `{name}` |" not in page] == []


# ---- random damage never ends in anything but a solution or a sentence of ours ------------------------------------

JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-200, 200),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.integers(-3, 3), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(-3, 3), max_size=2),
)


def places(value, path=()):
    """Every place of a nested table, the table itself first."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def holder(table, path):
    for key in path[:-1]:
        table = table[key]
    return table


@st.composite
def damaged(draw):
    table = copy.deepcopy(FILES[draw(st.sampled_from(sorted(FILES)))])
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from([place for place in places(table) if place]))
        inside, key = holder(table, path), path[-1]
        match draw(st.sampled_from(["drop", "junk", "swap", "repeat", "rename", "count"])):
            case "drop":
                del inside[key]
            case "junk":
                inside[key] = draw(JUNK)
            case "swap":
                other = draw(st.sampled_from([place for place in places(table) if place]))
                inside[key] = copy.deepcopy(holder(table, other)[other[-1]])
            case "repeat" if isinstance(inside, list):
                inside.append(copy.deepcopy(inside[key]))
            case "rename" if isinstance(inside, dict):
                inside[draw(st.text(min_size=1, max_size=6))] = inside.pop(key)
            case "count" if isinstance(inside[key], int):
                inside[key] = -inside[key] + draw(st.integers(-1, 1))
    return table


@settings(max_examples=100)
@given(damaged())
def test_damaged_files_end_in_a_solution_or_a_sentence(table):
    sentence = None
    try:
        kinematics = solve_kinematics(Gearbox.from_mapping(table))
        speeds = dict.fromkeys(kinematics.free, 1)
        assert len(defect_orders(kinematics, reference=kinematics.free[0], speeds=speeds)) > 0
    except GearboxError as error:
        sentence = str(error).rstrip()
    assert sentence is None or (len(sentence.split()) > 4 and sentence.endswith((".", "?", ")")))
