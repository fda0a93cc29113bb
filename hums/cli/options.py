"""Options that several commands share."""

__all__ = ["parse_speeds"]


def parse_speeds(texts: list[str] | None) -> dict[str, float] | None:
    """Return the speeds of options ``--speed LINK=RPM`` by link, in rpm; None without one."""
    return dict(_parse_speed(text) for text in texts) if texts else None


def _parse_speed(text: str) -> tuple[str, float]:
    link, separator, rpm = text.rpartition("=")
    try:
        return link, float(rpm)
    except ValueError:
        separator = ""
    if not separator:
        raise ValueError(f'--speed "{text}": write LINK=RPM, as in --speed "sun=1500".')
    return link, 0.0
