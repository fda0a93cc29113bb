"""What each field of a gearbox file means: the descriptions of its JSON schema."""

DESCRIPTIONS = {
    "Gearbox": {
        "name": "Name of the gearbox; default the name of the file.",
        "frame": "The link at rest: the housing, or the body to which speeds refer.",
        "reference": "The link to whose revolutions orders refer; default none, then name it for each analysis.",
        "rigid": "Groups of links that form one rigid body, such as a pinion cut into its shaft.",
        "link_order": "Order of the links in results; default as declared. Each link is listed once.",
        "axes": "Lines about which links rotate: under the name of each axis, a list of links or a table.",
        "mesh": "Pairs of gears in contact.",
        "bearing": "Rolling bearings. A bearing that is not declared is not assessed.",
    },
    "Axis": {
        "links": "The links on this line: those that rotate about it, and the one that carries them.",
        "direction": "Direction of the line as a vector of any length; default x. Two lines that are not parallel "
        "make a bevel, worm or crossed pair.",
        "parallel_to": "Name of an axis with the same direction, in place of direction.",
        "through": "A point of the line, x, y and z in mm; for drawings to scale, forces and bearing loads.",
        "copies": "Number of such axes around their carrier: planets. Their links are named planet 1, planet 2, ...",
        "spacing_deg": "Angle of each copy, degrees from the first, or the gaps between them, which add up to 360; "
        "default even.",
    },
    "Mesh": {
        "teeth": "Signed teeth of each gear: minus for an internal gear. One gear alone has an unknown mate.",
        "name": "Name of the mesh; default those of its gears.",
        "carrier": "The link in which the contact point is at rest; required for a single gear, else derived.",
        "kind": "worm, crossed_helical, belt or chain; default rolling gears.",
        "module_mm": "Normal module, mm: the drawing is to scale, and forces follow from torques.",
        "face_width_mm": "Width of the teeth along the axis, mm.",
        "pressure_angle_deg": "Normal pressure angle, degrees; tooth forces and bearing loads need it.",
        "helix_angle_deg": "Helix angle at the pitch circle, degrees; its sign, or hand, gives the direction.",
        "hand": "Hand of the helix of the first gear, left or right, for an unsigned helix angle.",
        "profile_shift": "Profile shift coefficient of each gear, in modules.",
        "pitch_angle_deg": "Angle of each gear's entry in the complex constraint matrix, degrees, as the papers' "
        "tables have it; the exact solution needs none.",
        "position_mm": "Position of the face centre along the axis of the first gear, mm from through of that axis.",
    },
    "Bearing": {
        "names": "One name for each bearing of this type and location, such as input DE and input NDE.",
        "name": "Name of a single bearing.",
        "inner_ring": "The link that carries the inner ring.",
        "outer_ring": "The link that carries the outer ring.",
        "bearing": "Name in the catalogue of bearings, from which the geometry follows; see hums bearings.",
        "elements": "Number of rolling elements in a row.",
        "element_diameter_mm": "Diameter of a rolling element, mm; mean diameter of a tapered or spherical roller.",
        "pitch_diameter_mm": "Diameter of the circle through the element centres, mm.",
        "contact_angle_deg": "Contact angle, degrees; 0 for a radial bearing.",
        "multiples": "Defect frequencies as printed in a data sheet, in place of the geometry.",
        "order_tolerance": "Relative deviation that its true defect orders may have; see hums bearings.",
        "position_mm": "Position of each bearing along its axis, mm from through, in the order of the names.",
        "takes_axial": "Names of the bearings that locate the shaft axially.",
    },
    "Multiples": {
        "inner": "BPFI per revolution of one ring relative to the other.",
        "outer": "BPFO per revolution of one ring relative to the other.",
        "cage": "FTF per revolution of the inner ring with the outer ring at rest; below 0.5.",
        "element_spin": "BSF, spin of a rolling element; its defect strikes both races, at twice this rate.",
        "element_defect": "Twice BSF, in place of element_spin.",
    },
}
"""Field descriptions by table of the file and field."""
