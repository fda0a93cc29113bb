"""Half-written files of processes that have ended."""

from hashlib import sha256
from socket import gethostname


def of_a_dead_writer(folder):
    """Make a half-written file of a process of this machine that is none, and return its path."""
    host = sha256(gethostname().encode()).hexdigest()[:8]
    part = folder / f".hums-0-{host}-{2**30}-1-0.part"
    part.write_text("half")
    return part
