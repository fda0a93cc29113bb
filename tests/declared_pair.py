"""Two gears as a scene declares them, one mesh on parallel axes: the gearbox of tests whose gears vibrate."""


def declared_pair(*, name="pair", teeth=(20, 40), wheel="wheel", module_mm=4, **mesh):
    """Return the table of a gearbox; `mesh` takes further keys of its mesh."""
    return {
        "name": name,
        "frame": "housing",
        "reference": "pinion",
        "axes": {"in": ["housing", "pinion"], "out": ["housing", wheel]},
        "mesh": [
            {
                "name": "mesh",
                "teeth": dict(zip(("pinion", wheel), teeth, strict=True)),
                "module_mm": module_mm,
                "face_width_mm": 30,
                "pressure_angle_deg": 20,
                **mesh,
            }
        ],
    }
