"""Fleets: many records of a machine in one table, with trends and alarms."""
