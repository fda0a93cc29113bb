"""A logger's table as a Western European one writes it."""

COUNT = 2000
ABOVE = (
    "Logger;DL-12\nSerial;4711\nOperator;Müller\nSite;3\nGain;1\nNote;a;b\nRange;10 V\nChannels;3\nFilter;off\n"
    "Firmware;2.1\nStart;27.10.2024 10:27:00\nZeit;DE [g];ND [mm/s];Öl [°C];Status\n"
)


def write_logger_table(path):
    """Write twelve lines above a table of semicolons, decimal commas, local times as text, three units and a status."""
    numbers = (f"{k / 8:.3f};-{k / 4:.2f};55.5".replace(".", ",") for k in range(COUNT))
    times = (f"27.10.2024 10:27:0{k // 1000},{k % 1000:03d}" for k in range(COUNT))
    rows = (f"{time};{cells};OK\n" for time, cells in zip(times, numbers, strict=True))
    path.write_text(ABOVE + "".join(rows), encoding="cp1252")
    return path
