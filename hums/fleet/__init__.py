"""Many records of a machine become one table, with trends."""
