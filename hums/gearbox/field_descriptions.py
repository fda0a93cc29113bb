"""What each field of a gearbox file means: the descriptions of its JSON schema."""

__all__ = ["DESCRIPTIONS"]

DESCRIPTIONS = {
    "Gearbox": {
        "name": "Name of the gearbox; default the name of the file.",
        "frame": "The link at rest: the housing, or the body that speeds are seen from.",
        "reference": "The link whose revolutions orders count; default none, then say it with every analysis.",
        "rigid": "Groups of links that are one body by several names, such as a pinion cut into its shaft.",
        "link_order": "Order of the links in results; default that of the declaration. Lists every link once.",
        "axes": "Lines about which links turn: a list of links, or a table of an axis, under the axis' name.",
        "mesh": "Pairs of gears in contact.",
        "bearing": "Rolling bearings. A bearing that is not declared is not looked for.",
    },
    "Axis": {
        "links": "The links on this line: what turns about it, and the one that carries them.",
        "direction": "Direction of the line as a vector of any length; default x. Two lines that are not parallel "
        "make a bevel, worm or crossed pair.",
        "parallel_to": "Name of an axis with the same direction, in place of direction.",
        "through": "A point of the line, x, y and z in mm; for drawings to scale, forces and bearing loads.",
        "copies": "Number of such axes round their carrier: planets. Their links are named planet 1, planet 2, ...",
        "spacing_deg": "Angle of each copy, degrees from the first, or the gaps between them, which add up to 360; "
        "default even.",
    },
    "Mesh": {
        "teeth": "Signed teeth of each gear: minus for an internal gear. One gear alone has an unknown mate.",
        "name": "Name of the mesh; default those of its gears.",
        "carrier": "The link in which the point of contact rests; needed for one gear alone, else found.",
        "kind": "worm, crossed_helical, belt or chain; default gears that roll on each other.",
        "module_mm": "Normal module, mm: the drawing is to scale, and forces follow from torques.",
        "face_width_mm": "Width of the teeth along the axis, mm.",
        "pressure_angle_deg": "Normal pressure angle, degrees; tooth forces and bearing loads need it.",
        "helix_angle_deg": "Helix angle at the pitch circle, degrees; its sign, or hand, says which way.",
        "hand": "Hand of the first gear's helix, left or right, with a helix angle without a sign.",
        "profile_shift": "Profile shift coefficient of each gear, in modules.",
        "pitch_angle_deg": "Angle of each gear's entry in the complex constraint matrix, degrees, as the papers' "
        "tables have it; the exact solution needs none.",
        "position_mm": "Where the middle of the face lies along the first gear's axis, mm from that axis' through.",
    },
    "Bearing": {
        "names": "One name for each bearing of this kind and place, such as input DE and input NDE.",
        "name": "Its name, where there is one alone.",
        "inner_ring": "The link that carries the inner ring.",
        "outer_ring": "The link that carries the outer ring.",
        "bearing": "Name in the catalogue of bearings, from which the geometry follows; see hums bearings.",
        "elements": "Number of rolling elements in a row.",
        "element_diameter_mm": "Diameter of a rolling element, mm; of a tapered or spherical roller the mean one.",
        "pitch_diameter_mm": "Diameter of the circle of the elements' centres, mm.",
        "contact_angle_deg": "Contact angle, degrees; 0 for a radial bearing.",
        "multiples": "Defect frequencies as a data sheet prints them, in place of the geometry.",
        "position_mm": "Where each supports its shaft, mm along the axis from its through, in the order of the names.",
        "takes_axial": "Those of the names that hold the shaft along its axis.",
    },
    "Multiples": {
        "inner": "BPFI per turn of one ring against the other.",
        "outer": "BPFO per turn of one ring against the other.",
        "cage": "FTF per turn of the inner ring, the outer one at rest; below 0.5.",
        "element_spin": "BSF, one turn of a rolling element; its defect strikes both races, twice as often.",
        "element_defect": "Twice BSF, in place of element_spin.",
    },
}
"""Field descriptions by table of the file and field."""
