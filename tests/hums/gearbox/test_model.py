"""The declared mechanism: what a file may say, what it means, and how a wrong one is refused."""

import copy
import pickle
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from hums.gearbox.components import Declared
from hums.gearbox.model import Bearing, Gearbox, GearboxError, GearboxWarning, Mesh, catalogue, load_gearbox

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

    def test_whole_numbers_pass_for_lengths(self, planetary):
        assert planetary.bearings[0].pitch_diameter_mm == 54.0
        assert planetary.meshes[0].profile_shift == (0.1, -0.1)

    def test_teeth_keep_their_sign(self, planetary):
        assert [(gear.link, gear.teeth) for gear in planetary.meshes[1].gears] == [("planet", 36), ("ring", -99)]

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

    def test_multiples_that_round_warn_with_the_numbers(self):
        with pytest.warns(GearboxWarning, match=r'"x": inner 9\.46 \+ outer 6\.72 = 16\.18'):
            Gearbox.from_mapping(sheet(inner=9.46, outer=6.72))

    def test_elements_that_the_multiples_round_to(self):
        table = sheet(inner=9.46, outer=6.72)
        table["bearing"][0]["elements"] = 16
        with pytest.warns(GearboxWarning, match=r"= 16\.18, not a whole number"):
            assert Gearbox.from_mapping(table).bearings[0].elements == 16

    def test_as_many_elements_as_fit(self):
        assert Gearbox.from_mapping(bearing(elements=31)).bearings[0].elements == 31

    @pytest.mark.parametrize(("inner", "outer"), [(5.415, 3.585), (5.42, 3.58), (5.42, 3.59)])
    def test_multiples_within_their_last_digit_are_silent(self, inner, outer):
        # two decimals each: the sum may miss a whole number by 0.01. A warning would fail this test.
        Gearbox.from_mapping(sheet(inner=inner, outer=outer))

    def test_changed_is_validated_again(self, planetary):
        assert planetary.changed(reference="carrier").reference == "carrier"
        with pytest.raises(ValidationError, match='names the link "moon"'):
            planetary.changed(reference="moon")


class TestNothingChangesLater:
    def test_deeply_frozen(self, planetary):
        seen = []

        def walk(value):
            seen.append(type(value))
            if isinstance(value, BaseModel):
                for name in type(value).model_fields:
                    with pytest.raises(ValidationError):
                        setattr(value, name, None)
                    walk(getattr(value, name))
            elif isinstance(value, tuple):
                for item in value:
                    walk(item)
            else:
                assert value is None or isinstance(value, str | int | float)

        walk(planetary)
        assert Bearing in seen
        assert Mesh in seen

    def test_answers_are_the_askers_own(self, planetary):
        planetary.copied["planet"] = 5
        assert planetary.copied == {"planet": 3}

    def test_the_table_it_was_read_from_may_change(self):
        table = pair()
        box = Gearbox.from_mapping(table)
        table["axes"]["one"].append("c")
        table["mesh"][0]["teeth"]["a"] = 1
        assert box == Gearbox.from_mapping(pair())

    def test_equal_hashable_and_portable(self, planetary):
        twin = pickle.loads(pickle.dumps(planetary))  # noqa: S301
        assert twin == planetary == copy.deepcopy(planetary)
        assert len({twin, planetary}) == 1

    def test_every_table_of_a_file_is_strict_and_frozen(self):
        tables = [Declared]
        for table in tables:
            tables += table.__subclasses__()
            config = table.model_config
            assert (config["strict"], config["frozen"], config["extra"]) == (True, True, "forbid"), table


class TestRefusals:
    @pytest.mark.parametrize("teeth", [True, "3", 2.5, 20.0, None, [3]])
    def test_what_is_not_a_count_of_teeth(self, teeth):
        message = refusal(mesh(teeth={"a": teeth, "b": 41}))
        assert "teeth" in message
        # a list is shown as the tuple it has become
        assert repr(tuple(teeth) if isinstance(teeth, list) else teeth) in message

    def test_no_teeth_at_all(self):
        assert 'gear "a" has 0 teeth' in refusal(mesh(teeth={"a": 0, "b": 41}))
        assert "write teeth = {" in refusal(mesh(teeth={}))
        assert "write teeth = {" in refusal(mesh(teeth=[20, 41]))
        assert "at most 2" in refusal(mesh(teeth={"a": 20, "b": 41, "h": 7}))

    @pytest.mark.parametrize(
        ("table", "typo", "meant"),
        [
            (pair(refrence="a"), "refrence", "reference"),
            (pair(reference=None, mesh=None, meshs=[]), "meshs", "mesh"),
            (pair(mesh=[{"teth": {"a": 20, "b": 41}}]), "teth", "teeth"),
            (mesh(carier="h"), "carier", "carrier"),
            (mesh(modul_mm=2.0), "modul_mm", "module_mm"),
            (pair(axes={"one": {"link": ["h", "a"]}, "two": ["h", "b"]}), "link", "links"),
            (pair(axes={"one": {"links": ["h", "a"], "copys": 3}, "two": ["h", "b"]}), "copys", "copies"),
            (bearing(pitch_diametr_mm=3.0), "pitch_diametr_mm", "pitch_diameter_mm"),
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
        assert "teeth" in message
        assert "gears" not in message  # nobody writes that

    @pytest.mark.parametrize(
        ("table", "words"),
        [
            (mesh(teeth={"a": 20, "bb": 41}), ['mesh "a-bb" names the link "bb"', 'did you mean "b"?']),
            (mesh(carrier="hh"), ['mesh "a-b" names the link "hh"', 'did you mean "h"?']),
            (pair(frame="hh"), ['frame = "hh" is on no axis', 'did you mean "h"?']),
            (pair(reference="c"), ['reference names the link "c"']),
            (bearing(inner_ring="aa"), ['bearing "x" names the link "aa"', 'did you mean "a"?']),
            (pair(frame=None), ["frame is missing"]),
            (pair(axes=None), ["axes is missing"]),
        ],
    )
    def test_links_that_do_not_exist(self, table, words):
        message = refusal(table)
        assert all(word in message for word in words), message

    @pytest.mark.parametrize(
        ("table", "words"),
        [
            (pair(mesh=[{"teeth": {"a": 20, "b": 41}}] * 2), 'two of kind mesh are called "a-b"'),
            (pair(bearing=[{"name": "x"} | BALL] * 2), 'two of kind bearing are called "x"'),
            (pair(bearing=[{"names": ["x", "x"]} | BALL]), 'two of kind bearing are called "x"'),
            (pair(axes={"one": ["h", "a", "a"], "two": ["h", "b"]}), "a link is listed twice"),
            (
                pair(
                    axes={
                        "one": ["h", "a"],
                        "two": ["h", "b"],
                        "p": {"links": ["a", "c"], "copies": 2},
                        "q": ["h", "c 1"],
                    }
                ),
                'the link "c 1" has the name of a numbered copy',
            ),
            (
                pair(
                    axes={
                        "one": ["h", "a"],
                        "two": ["h", "b"],
                        "p": {"links": ["a", "c"], "copies": 2},
                        "p 2": ["h", "d"],
                    }
                ),
                'the axis "p 2" has the name of a numbered copy',
            ),
        ],
    )
    def test_duplicate_names(self, table, words):
        assert words in refusal(table)

    @pytest.mark.parametrize(
        ("one", "two", "words"),
        [
            ({"parallel_to": "two"}, {"parallel_to": "one"}, "leads round in a circle (one, two)"),
            ({"parallel_to": "one"}, {}, 'parallel_to = "one" is no other axis'),
            ({"parallel_to": "three"}, {}, 'parallel_to = "three" is no other axis'),
            ({"parallel_to": "two", "direction": [1, 0, 0]}, {}, "keep one"),
            ({"direction": [0, 0, 0]}, {}, "[0.0, 0.0, 0.0] is no direction"),
            ({"direction": [float("nan"), 0, 1]}, {}, "finite"),
            ({"direction": [True, 0, 0]}, {}, "direction.1 = True"),
            ({"direction": [1, 0]}, {}, "direction.3 is missing"),
            ({"through": [0, float("inf"), 0]}, {}, "finite"),
            ({"copies": 1}, {}, "greater than or equal to 2"),
            ({"copies": 3, "spacing_deg": [0, 120]}, {}, "2 angles for 3 copies"),
        ],
    )
    def test_axes(self, one, two, words):
        axes = {"one": {"links": ["h", "a"]} | one, "two": {"links": ["h", "b"]} | two}
        assert words in refusal(pair(axes=axes))

    def test_copies_that_cannot_be_paired(self):
        axes = {
            "main": ["h", "a", "c"],
            "p": {"links": ["c", "p"], "copies": 3},
            "q": {"links": ["c", "q"], "copies": 2},
        }
        message = refusal(pair(axes=axes, mesh=[{"teeth": {"p": 20, "q": 20}}]))
        assert '"q" of 2 copies and "p" of 3 copies' in message
        assert "joins" in refusal(pair(axes=axes, mesh=None, rigid=[["p", "q"]]))
        axes["q"]["links"] = ["c", "p"]
        assert '"p" is on axes with' in refusal(pair(axes=axes, mesh=None))

    def test_a_gear_alone_needs_its_carrier(self):
        assert 'add carrier = "..."' in refusal(mesh(teeth={"a": 20}))
        assert Gearbox.from_mapping(mesh(teeth={"a": 20}, carrier="h")).meshes[0].name == "a-unknown"

    @pytest.mark.parametrize(
        ("table", "words"),
        [
            (sheet(ball=2.87, element_spin=None), '"ball" is ambiguous; say element_spin'),
            (sheet(element_defect=5.7), "exactly one of element_spin and element_defect"),
            (sheet(element_spin=None), "exactly one of element_spin and element_defect"),
            (sheet(inner=-9.5), "inner = -9.5: input should be greater than 0"),
            (sheet(inner=0.7, outer=0.4), "number of elements, at least 2"),
            (sheet(cage=None), "cage is missing"),
            (sheet(cage=0.2), "cage = 0.2, but elements that roll at inner 9.5 and outer 6.5 carry it round at 0.406"),
            (sheet(cage=0.594), "cage = 0.594 (this is the cage against the inner ring)"),
            (
                sheet(element_spin=5.14),
                "have 2.47 to 2.57; is it the defect on both races, twice the spin? Then call it element_defect",
            ),
            (
                sheet(element_spin=None, element_defect=2.6),
                "have 4.95 to 5.15; is it one turn of the element? Then call it element_spin",
            ),
            (sheet(element_spin=0.3), "element_spin = 0.3 is impossible: elements that roll"),
            (sheet(inner=6.5, outer=9.5), "inner = 6.5 is not above outer = 9.5"),
            (sheet(inner=8, outer=8), "inner = 8 is not above outer = 8"),
            (
                pair(bearing=[{"name": "x", "inner_ring": "a", "outer_ring": "h", "elements": 9, "multiples": SHEET}]),
                "multiples inner 9.5 + outer 6.5 = 16 is not the number of elements, 9",
            ),
            (
                bearing(elements=32),
                "32 elements of element_diameter_mm = 5 do not fit on the pitch circle, which is 157.1",
            ),
            (bearing(multiples=SHEET), "both multiples and diameters are given"),
            (
                bearing(position_mm=[1, 2]),
                "position_mm = [1.0, 2.0] does not fit the names x; give one position for each",
            ),
            (bearing(position_mm=[float("inf")]), "finite"),
            (bearing(takes_axial=["y"]), 'takes_axial names "y", which is not one of its names; valid: x'),
            (mesh(pressure_angle_deg=90), "pressure_angle_deg = 90: input should be less than 90"),
            (mesh(helix_angle_deg=90), "helix_angle_deg = 90: input should be less than 90"),
            (mesh(helix_angle_deg=-95), "helix_angle_deg = -95: input should be greater than -90"),
            (
                pair(bearing=[BALL | {"names": "hss bearing"}]),
                "names = 'hss bearing': give a list in brackets, as in [\"hss bearing\"]",
            ),
            (mesh(profile_shift=0.2), "profile_shift = 0.2: give a list in brackets, as in [0.2]"),
            (mesh(hand="left"), 'hand = "left" goes with no helix_angle_deg; give helix_angle_deg without a sign'),
            (mesh(hand="right", helix_angle_deg=-15), "goes with -15 degrees; give helix_angle_deg without a sign"),
            (bearing(elements=None), "pitch_diameter_mm, bearing = a name of `hums bearings`, or multiples = {"),
            (bearing(element_diameter_mm=50), "element_diameter_mm = 50.0 is not below pitch_diameter_mm = 50.0"),
            (bearing(contact_angle_deg=90), "less than 90"),
            (bearing(contact_angle_deg=float("nan")), "finite"),
            (bearing(elements=True), "elements = True"),
            (bearing(pitch_diameter_mm="50"), "pitch_diameter_mm = '50'"),
            (
                pair(bearing=[{"name": "x", "inner_ring": "a", "outer_ring": "h", "elements": 9}]),
                "give elements, element",
            ),
        ],
    )
    def test_bearings(self, table, words):
        assert words in refusal(table)

    def test_two_errors_are_two_sentences(self):
        message = refusal(pair(frame=3, mesh=[{"teeth": {"a": True, "b": 41}}]))
        assert message == (
            "gearbox: frame = 3: input should be a valid string; "
            "mesh.1.gears.1.teeth = True: input should be a valid integer."
        )

    def test_what_follows_from_an_error_is_not_told(self):
        assert refusal(pair(axes={"one": ["h", 3], "two": ["h", "b"]})) == (
            "gearbox: axes.1.links.2 = 3: input should be a valid string."
        )


class TestFiles:
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
        with pytest.raises(GearboxError, match=r"/dev/zero is no regular file"):
            load_gearbox(Path("/dev/zero"))

    @pytest.mark.parametrize("name", ["y" * 5000, "y" * 5000 + ".toml", "a\0b.toml"])
    def test_names_that_no_file_has(self, name):
        with pytest.raises((ValueError, TypeError), match=r"no (file|path) may have") as caught:
            load_gearbox(name)
        assert len(str(caught.value)) <= 1000

    def test_missing(self, tmp_path):
        with pytest.raises(GearboxError, match="no such file"):
            load_gearbox(tmp_path / "nowhere.toml")

    def test_directory(self, tmp_path):
        with pytest.raises(GearboxError, match="is a directory"):
            load_gearbox(tmp_path)

    @pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
    def test_catalogue(self):
        shipped = catalogue()
        assert {"two-stage", "planetary-27-36-99"} <= set(shipped)
        for name, path in shipped.items():
            assert load_gearbox(name) == load_gearbox(str(path))

    def test_a_name_near_one_of_the_catalogue(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(GearboxError, match='did you mean "two-stage"'):
            load_gearbox("two-stag")
