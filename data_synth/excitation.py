"""How loud the healthy gearbox is, as a scene declares it."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer

from data_synth.driving import NotNegative, Share
from hums.gearbox import Declared, Name


def _pairs(value: Any) -> Any:  # noqa: ANN401
    return tuple(value.items()) if isinstance(value, Mapping) else value


Amplitudes = Annotated[tuple[tuple[Name, NotNegative], ...], BeforeValidator(_pairs), PlainSerializer(dict)]


class Excitation(Declared):
    """Amplitudes at the source of the healthy gearbox: harmonic k has ``decay ** (k - 1)`` of the first.

    Shafts speak with `shaft_amplitude` each, whatever the load; meshes with `mesh_amplitude` at full load; those that
    `shafts` and `meshes` name, with the amplitude of their own, as in ``meshes = { "stage 2" = 0.2 }``. All of it goes
    with the power `speed_exponent` of speed over top speed: 0 leaves amplitudes as they are, 2 is that of an imbalance,
    and what a run-up from rest needs.
    """

    shaft_amplitude: NotNegative = 0.05
    mesh_amplitude: NotNegative = 0.5
    shafts: Amplitudes = ()
    meshes: Amplitudes = ()
    harmonics: Annotated[int, Field(ge=1)] = 3
    decay: Share = 0.5
    speed_exponent: NotNegative = 0.0

    def amplitude(self, kind: str, component: str) -> float:
        """Return that of the first harmonic of a shaft or a mesh (kind `shaft` or `gear_mesh`)."""
        own, common = (self.shafts, self.shaft_amplitude) if kind == "shaft" else (self.meshes, self.mesh_amplitude)
        return dict(own).get(component, common)
