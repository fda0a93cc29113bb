"""The declared mechanism: what a file may say, what it means, and how a wrong one is refused."""

import copy
import pickle
from pathlib import Path

import pytest
from pydantic import ValidationError

from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning, load_gearbox

PLANETARY = """
frame = "housing"
reference = "sun"
rigid = [["housing", "ring"]]
[axes]
main   = ["housing", "sun", "ring", "carrier"]
planet = { links = ["carrier", "planet"], copies = 3, spacing_deg = [0, 120, 240] }
[[mesh]]
teeth = { sun = 27, planet = 36 }
module_mm = 2
profile_shift = [0.1, -0.1]
[[mesh]]
teeth = { planet = 36, ring = -99 }
[[bearing]]
names = ["carrier front", "carrier rear"]
inner_ring = "carrier"
outer_ring = "housing"
elements = 25
element_diameter_mm = 5
pitch_diameter_mm = 54
contact_angle_deg = 15
[[bearing]]
name = "by data sheet"
inner_ring = "sun"
outer_ring = "housing"
multiples = { inner = 9.5, outer = 6.5, element_spin = 2.87, cage = 0.41 }
"""
BALL = {"inner_ring": "a", "outer_ring": "h", "elements": 9, "element_diameter_mm": 5, "pitch_diameter_mm": 50}
SHEET = {"inner": 9.5, "outer": 6.5, "element_spin": 2.87, "cage": 0.41}


def pair(**changes):
    """Two shafts side by side and one mesh, with some of its keys changed."""
    table = {
        "name": "pair",
        "frame": "h",
        "reference": "a",
        "axes": {"one": ["h", "a"], "two": ["h", "b"]},
        "mesh": [{"teeth": {"a": 20, "b": 41}}],
    }
    return {key: value for key, value in (table | changes).items() if value is not None}


def mesh(**changes):
    return pair(mesh=[{"teeth": {"a": 20, "b": 41}} | changes])


def bearing(**changes):
    return pair(bearing=[{"name": "x"} | BALL | changes])


def sheet(**changes):
    multiples = {key: value for key, value in (SHEET | changes).items() if value is not None}
    return pair(bearing=[{"name": "x", "inner_ring": "a", "outer_ring": "h", "multiples": multiples}])


def refusal(table):
    with pytest.raises(GearboxError) as caught:
        Gearbox.from_mapping(table)
    return str(caught.value)


@pytest.fixture
def planetary(tmp_path):
    path = tmp_path / "planetary.toml"
    path.write_text(PLANETARY, encoding="utf-8")
    return load_gearbox(path)


class TestWhatAFileMeans:
    def test_names_that_are_not_written(self, planetary):
        assert planetary.name == "planetary"  # after the file
        assert [mesh.name for mesh in planetary.meshes] == ["sun-planet", "planet-ring"]
        assert Gearbox.from_mapping(mesh(teeth={"a": 20}, carrier="h")).meshes[0].name == "a-unknown"
        assert [bearing.names for bearing in planetary.bearings] == [
            ("carrier front", "carrier rear"),
            ("by data sheet",),
        ]

    def test_copies_are_numbered(self, planetary):
        assert planetary.copied == {"planet": 3}
        assert planetary.instances("planet") == ("planet 1", "planet 2", "planet 3")
        assert planetary.instances("carrier") == ("carrier",)
        assert planetary.links == ("housing", "sun", "ring", "carrier", "planet 1", "planet 2", "planet 3")

    def test_a_gear_on_no_axis_exists_as_often_as_what_it_is_rigid_with(self):
        axes = {"main": ["h", "s", "c"], "p": {"links": ["c", "big"], "copies": 3}}
        box = Gearbox.from_mapping(
            pair(reference="s", axes=axes, mesh=None, rigid=[["small", "mark"], ["big", "small"]])
        )
        assert box.copied == {"big": 3, "small": 3, "mark": 3}

    def test_directions(self):
        axes = {
            "one": {"links": ["h", "a"], "direction": [3, 0, -4]},
            "two": {"links": ["h", "b"], "parallel_to": "one"},
            "three": ["h", "c"],
        }
        box = Gearbox.from_mapping(pair(axes=axes))
        # 3-4-5: exact but for the division
        assert box.direction("one") == pytest.approx((0.6, 0.0, -0.8), abs=1e-15)
        assert box.direction("two") == box.direction("one")
        assert box.direction("three") == (1.0, 0.0, 0.0)

    @pytest.mark.parametrize(
        ("multiples", "defect"), [({}, 5.74), ({"element_spin": None, "element_defect": 5.7}, 5.7)]
    )
    def test_a_defect_on_an_element_meets_both_races(self, multiples, defect):
        assert Gearbox.from_mapping(sheet(**multiples)).bearings[0].multiples.defect == defect

    def test_elements_that_the_multiples_round_to(self):
        table = sheet(inner=9.46, outer=6.72)
        table["bearing"][0]["elements"] = 16
        with pytest.warns(GearboxWarning, match=r"= 16\.18, not a whole number"):
            assert Gearbox.from_mapping(table).bearings[0].elements == 16

    @pytest.mark.parametrize(("inner", "outer"), [(5.415, 3.585), (5.42, 3.58), (5.42, 3.59)])
    def test_multiples_within_their_last_digit_are_silent(self, inner, outer):
        # two decimals each: the sum may miss a whole number by 0.01. A warning would fail this test.
        Gearbox.from_mapping(sheet(inner=inner, outer=outer))

    def test_changed_is_validated_again(self, planetary):
        assert planetary.changed(reference="carrier").reference == "carrier"
        with pytest.raises(ValidationError, match='names the link "moon"'):
            planetary.changed(reference="moon")


class TestNothingChangesLater:
    def test_equal_hashable_and_portable(self, planetary):
        twin = pickle.loads(pickle.dumps(planetary))  # noqa: S301
        assert twin == planetary == copy.deepcopy(planetary)
        assert len({twin, planetary}) == 1


def axes(one, **two):
    return pair(axes={"one": {"links": ["h", "a"]} | one, "two": {"links": ["h", "b"]} | two})


def copied(**more):
    return pair(axes={"one": ["h", "a"], "two": ["h", "b"], "p": {"links": ["a", "c"], "copies": 2}} | more)


UNPAIRED = {"main": ["h", "a", "c"], "p": {"links": ["c", "p"], "copies": 3}, "q": {"links": ["c", "q"], "copies": 2}}
NO_SIZE = {"name": "x", "inner_ring": "a", "outer_ring": "h", "elements": 9}


class TestRefusals:
    @pytest.mark.parametrize(
        ("table", "words"),
        [
            (mesh(teeth={"a": [3], "b": 41}), "(3,)"),  # a list is shown as the tuple it has become
            (mesh(teeth={"a": 0, "b": 41}), 'gear "a" has 0 teeth'),
            (mesh(teeth=[20, 41]), "write teeth = {"),
            (mesh(teeth={"a": 20}), 'add carrier = "..."'),
            # links
            (
                mesh(teeth={"a": 20, "bb": 41}),
                'mesh "a-bb" names the link "bb", which is on no axis; did you mean "b"?',
            ),
            (pair(frame="hh"), 'frame = "hh" is on no axis'),
            (pair(reference="c"), 'reference names the link "c"'),
            (pair(frame=None), "frame is missing"),
            # names given twice
            (pair(mesh=[{"teeth": {"a": 20, "b": 41}}] * 2), 'two items of kind mesh are named "a-b"'),
            (pair(bearing=[{"names": ["x", "x"]} | BALL]), 'two items of kind bearing are named "x"'),
            (pair(axes={"one": ["h", "a", "a"], "two": ["h", "b"]}), "a link is listed twice"),
            (copied(q=["h", "c 1"]), 'the link "c 1" has the name of a numbered copy'),
            (copied(**{"p 2": ["h", "d"]}), 'the axis "p 2" has the name of a numbered copy'),
            # copies that cannot be paired
            (pair(axes=UNPAIRED, mesh=[{"teeth": {"p": 20, "q": 20}}]), '"q" of 2 copies and "p" of 3 copies'),
            (pair(axes=UNPAIRED, mesh=None, rigid=[["p", "q"]]), "joins"),
            (pair(axes=UNPAIRED | {"q": {"links": ["c", "p"], "copies": 2}}, mesh=None), '"p" is on axes with'),
            # axes
            (axes({"parallel_to": "two"}, parallel_to="one"), "is circular (one, two)"),
            (axes({"parallel_to": "one"}), 'parallel_to = "one" is not another axis'),
            (axes({"parallel_to": "two", "direction": [1, 0, 0]}), "keep one"),
            (axes({"direction": [0, 0, 0]}), "[0.0, 0.0, 0.0] is not a direction"),
            (axes({"copies": 3, "spacing_deg": [0, 120]}), "2 angles for 3 copies"),
            (axes({"copies": 3, "spacing_deg": [0, 240, 120]}), "spacing_deg"),
            # bearings
            (sheet(ball=2.87, element_spin=None), '"ball" is ambiguous; write element_spin'),
            (sheet(element_defect=5.7), "exactly one of element_spin and element_defect"),
            (sheet(inner=0.7, outer=0.4), "number of elements, at least 2"),
            (sheet(cage=0.2), "cage = 0.2 contradicts inner 9.5 and outer 6.5, for which the cage rotates at 0.406"),
            (sheet(cage=0.594), "cage = 0.594 (that relative to the inner ring)"),
            (sheet(element_spin=5.14), "if it is the defect on both races, twice the spin, call it element_defect"),
            (
                sheet(element_spin=None, element_defect=2.6),
                "if it is the rotation of the element, call it element_spin",
            ),
            (sheet(element_spin=0.3), "element_spin = 0.3 contradicts inner"),
            (sheet(inner=8, outer=8), "inner = 8 is not above outer = 8"),
            (pair(bearing=[NO_SIZE | {"multiples": SHEET}]), "9.5 + outer 6.5 = 16 is not the number of elements, 9"),
            (bearing(elements=32), "32 elements of element_diameter_mm = 5 do not fit on the pitch circle"),
            (bearing(multiples=SHEET), "both multiples and diameters are given"),
            (
                bearing(position_mm=[1, 2]),
                "position_mm = [1.0, 2.0] does not match the names x; give one position for each",
            ),
            (bearing(takes_axial=["y"]), 'takes_axial names "y", which is not one of its names; valid: x'),
            (pair(bearing=[BALL | {"names": "hss"}]), "names = 'hss': give a list in brackets, as in [\"hss\"]"),
            (bearing(elements=None), "pitch_diameter_mm, bearing = a name from `hums bearings`, or multiples = {"),
            (bearing(element_diameter_mm=50), "element_diameter_mm = 50.0 is not below pitch_diameter_mm = 50.0"),
            # meshes
            (mesh(hand="left"), 'hand = "left" is given with no helix_angle_deg; give helix_angle_deg without a sign'),
            (mesh(hand="right", helix_angle_deg=-15), "is given with -15 degrees; give helix_angle_deg without a sign"),
            # two errors are two sentences, and what follows from an error is not told
            (
                pair(frame=3, mesh=[{"teeth": {"a": True, "b": 41}}]),
                "frame = 3: input should be a valid string; mesh.1.gears.1.teeth = True: input should be a",
            ),
            (
                pair(axes={"one": ["h", 3], "two": ["h", "b"]}),
                "gearbox: axes.1.links.2 = 3: input should be a valid string.",
            ),
        ],
    )
    def test_what_is_wrong_is_named(self, table, words):
        assert words in refusal(table)

    @pytest.mark.parametrize(
        ("table", "typo", "meant"),
        [
            (pair(refrence="a"), "refrence", "reference"),
            (mesh(carier="h"), "carier", "carrier"),
            (pair(axes={"one": {"link": ["h", "a"]}, "two": ["h", "b"]}), "link", "links"),
            (sheet(inne=3.0), "inne", "inner"),
        ],
    )
    def test_a_misspelt_key_is_named_with_its_value_the_nearest_and_all_allowed_ones(self, table, typo, meant):
        message = refusal(table)
        said, _, allowed = message.partition("; allowed keys: ")
        assert f'unknown key "{typo}"; did you mean "{meant}"? Its value is ' in said
        assert meant in allowed.rstrip(".").split(", ")
        assert "\n" not in message

    def test_a_key_like_no_other_is_named_with_its_value(self):
        message = refusal(mesh(zzz=1))
        assert 'unknown key "zzz". Its value is 1; allowed keys: carrier, face_width_mm' in message
        assert "gears" not in message  # nobody writes that


class TestFiles:
    @pytest.mark.parametrize(("name", "words"), [("nowhere.toml", "no such file"), (".", "is a directory")])
    def test_no_file(self, tmp_path, name, words):
        with pytest.raises(GearboxError, match=words):
            load_gearbox(tmp_path / name)

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            (b"", "is empty"),
            (b"  \n\t\n", "is empty"),
            ("name = 'Getriebe für'".encode("latin-1"), "is not UTF-8 text (byte 18)"),
            (b"frame = ", "is not valid TOML"),
            (b"[axes]\nmain = ['h']\nmain = ['h']", "is not valid TOML"),
            (b"just text", "is not valid TOML"),
            (b"x = 1", 'unknown key "x"'),
        ],
    )
    def test_content_that_is_no_gearbox(self, tmp_path, content, words):
        path = tmp_path / "box.toml"
        path.write_bytes(content)
        with pytest.raises(GearboxError) as caught:
            load_gearbox(path)
        assert words in str(caught.value)
        assert str(path) in str(caught.value)
        assert caught.value.__cause__ is None  # the sentence stands alone, no chain of internals

    @pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no devices here")
    def test_a_device_is_no_file(self):
        with pytest.raises(GearboxError, match=r"/dev/zero is not a regular file"):
            load_gearbox(Path("/dev/zero"))

    @pytest.mark.parametrize("name", ["y" * 5000, "y" * 5000 + ".toml", "a\0b.toml"])
    def test_names_that_no_file_has(self, name):
        with pytest.raises((ValueError, TypeError), match=r"file names are limited|which no path may") as caught:
            load_gearbox(name)
        assert len(str(caught.value)) <= 1000

    def test_a_name_near_one_of_the_catalogue(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(GearboxError, match='did you mean "two-stage"'):
            load_gearbox("two-stag")
