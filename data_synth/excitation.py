"""Source amplitudes of the healthy gearbox, as a scene declares them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer

from data_synth.driving import NotNegative, Share
from hums.gearbox import Declared, Name


def _pairs(value: Any) -> Any:  # noqa: ANN401
    return tuple(value.items()) if isinstance(value, Mapping) else value


Amplitudes = Annotated[tuple[tuple[Name, NotNegative], ...], BeforeValidator(_pairs), PlainSerializer(dict)]


class Excitation(Declared):
    """Source amplitudes of the healthy gearbox; harmonic k has ``decay ** (k - 1)`` of the first.

    Each shaft has `shaft_amplitude`, independent of the load; each mesh has `mesh_amplitude` at full load. `shafts` and
    `meshes` give single ones another amplitude, as in ``meshes = { "stage 2" = 0.2 }``. All amplitudes are proportional
    to ``(speed / top speed) ** speed_exponent``: 0 keeps them constant, 2 is that of an imbalance, and suits a run-up
    from rest.
    """

    shaft_amplitude: NotNegative = 0.05
    mesh_amplitude: NotNegative = 0.5
    shafts: Amplitudes = ()
    meshes: Amplitudes = ()
    harmonics: Annotated[int, Field(ge=1)] = 3
    decay: Share = 0.5
    speed_exponent: NotNegative = 0.0

    def amplitude(self, kind: str, component: str) -> float:
        """Return the amplitude of the first harmonic of a shaft (kind `shaft`) or a mesh (kind `gear_mesh`)."""
        own, common = (self.shafts, self.shaft_amplitude) if kind == "shaft" else (self.meshes, self.mesh_amplitude)
        return dict(own).get(component, common)
