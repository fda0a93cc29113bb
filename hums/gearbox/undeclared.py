"""What a gearbox file leaves out, so that nothing of it can be found in a record."""

from hums.gearbox.components import first_of
from hums.gearbox.mechanism import build_mechanism
from hums.gearbox.model import Gearbox
from signals._validation import checked

_MOST_NAMED = 12


@checked
def undeclared_parts(gearbox: Gearbox) -> list[str]:
    """Return a sentence for each kind of part that a machine has and its gearbox file does not declare.

    Parameters
    ----------
    gearbox : Gearbox
        From `hums.load_gearbox`.

    Returns
    -------
    list of str
        Bodies that turn and have no bearing; no gear mesh at all. Empty where nothing is known to be missing.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.undeclared import undeclared_parts
    >>> undeclared_parts(hums.load_gearbox("two-stage"))
    ['No bearing is declared on output: damage to its bearings was not assessed.']
    """
    mechanism = build_mechanism(gearbox)
    borne = {
        mechanism.bodies[name]
        for bearing in gearbox.bearings
        for ring in (bearing.inner_ring, bearing.outer_ring)
        for name in gearbox.instances(ring)
    }
    bare = list(dict.fromkeys(gearbox.copy_links.get(body, body) for body in mechanism.joints if body not in borne))
    said = []
    if bare:
        whose = "its" if len(bare) == 1 else "their"
        said.append(
            f"No bearing is declared on {first_of(bare, _MOST_NAMED)}: damage to {whose} bearings was not assessed."
        )
    if not gearbox.meshes:
        said.append("No gear mesh is declared: damage to teeth was not assessed.")
    return said
