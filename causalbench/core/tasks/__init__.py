"""Tasks: data plus pure functions of facts, written once for every simulator."""
