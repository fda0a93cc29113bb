"""Pages that stand alone: HTML with plotly's script, the figures' data, a style for screen, dark rooms and paper."""
