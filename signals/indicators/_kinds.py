"""Check that an indicator gets the kind of signal it is defined on."""

_MADE_BY = {
    "SynchronousAverage": "synchronous_average",
    "ResidualSignal": "residual_signal",
    "DifferenceSignal": "difference_signal",
    "RegularSignal": "regular_signal",
    "MeshBand": "mesh_band",
    "AmplitudeSpectrum": "envelope_order_spectrum",
}


def expect(signal: object, kind: type, *, indicator: str) -> None:
    if not isinstance(signal, kind):
        raise TypeError(
            f"{indicator} takes a {kind.__name__}, not a {type(signal).__name__}: it is defined for that signal alone. "
            f"Make one with signals.{_MADE_BY[kind.__name__]}."
        )
