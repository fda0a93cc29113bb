"""Statistics of many records: baselines, control charts, limits, alarms, trends and forecasts of series of numbers."""
