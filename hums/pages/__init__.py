"""Self-contained HTML pages: plotly's script, the figures' data, and styles for light, dark and paper."""
